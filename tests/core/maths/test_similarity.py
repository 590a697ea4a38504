"""Similarities keep centimetres of georeferenced captures, and pictures as they are."""

import math

import torch

from gsfw.core.maths.similarity import Similarity


def turned(angle: float = 0.7) -> torch.Tensor:
    """A rotation about a skew axis."""
    axis = torch.tensor([0.48, -0.6, 0.64], dtype=torch.float64)
    cross = torch.tensor(
        [[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]],
        dtype=torch.float64,
    )
    return torch.matrix_exp(angle * cross)


GENERAL = Similarity(2.5, turned(), torch.tensor([3.0, -4.0, 5.0], dtype=torch.float64))


def test_the_default_is_the_identity():
    points = torch.rand(4, 3, generator=torch.Generator().manual_seed(0))
    assert torch.equal(Similarity().apply(points), points.double())


def test_points_are_scaled_rotated_and_moved():
    quarter = Similarity(2.0, turned(0.0), torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64))
    point = torch.tensor([[1.0, 2.0, 3.0]])
    assert quarter.apply(point).tolist() == [[3.0, 4.0, 6.0]]
    about_z = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=torch.float64)
    assert Similarity(1.0, about_z).apply(point).tolist() == [[-2.0, 1.0, 3.0]]


def test_the_inverse_leads_back():
    points = torch.randn(50, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert torch.allclose(GENERAL.inverse().apply(GENERAL.apply(points)), points, atol=1e-14)
    assert torch.allclose(GENERAL.apply(GENERAL.inverse().apply(points)), points, atol=1e-14)


def test_georeferenced_coordinates_keep_a_tenth_of_a_millimetre_in_a_float32_scene():
    # A capture of 100 m in UTM coordinates: float32 alone would be off by up to 0.25 m there.
    generator = torch.Generator().manual_seed(0)
    origin = torch.tensor([412_345.0, 5_312_345.0, 520.0], dtype=torch.float64)
    world = origin + 100 * torch.rand(200, 3, generator=generator, dtype=torch.float64)
    scene_from_world = Similarity(0.01, translation=-0.01 * origin)
    scene = scene_from_world.apply(world).float()
    back = scene_from_world.inverse().apply(scene)
    assert float((back - world).abs().max()) < 1e-4
    assert float((world.float().double() - world).abs().max()) > 0.1


def test_a_moved_camera_sees_moved_points_at_the_same_pixels_and_scaled_depth():
    points = torch.randn(50, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = turned(-1.2)
    pose[:3, 3] = torch.tensor([0.1, 0.2, 6.0])
    moved = GENERAL.camera(pose[None])[0]
    assert torch.allclose(moved[:3, :3] @ moved[:3, :3].T, torch.eye(3, dtype=torch.float64))
    assert math.isclose(float(moved[:3, :3].det()), 1.0)
    before = points @ pose[:3, :3].T + pose[:3, 3]
    after = GENERAL.apply(points) @ moved[:3, :3].T + moved[:3, 3]
    assert torch.allclose(after, 2.5 * before, atol=1e-12)
