"""Small motions of cameras: gradients, what is shared, and what stays where it is."""

import math
from dataclasses import replace

import pytest
import torch
from support.perturbed_captures import FewViews, around
from support.scenes import random_splats

from gsfw.core.datamanager import Split
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.pose_refinement import (
    PoseRefinement,
    common_motions,
    motion_matrices,
    scene_depths,
)
from gsfw.core.loop.refined_capture import RefinedCapture
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

RATE = LearningRate(1e-3)
CPU = torch.device("cpu")


def refinement(data=None, **motions) -> PoseRefinement:
    poses = PoseRefinement(data or FewViews(), RATE)
    with torch.no_grad():
        for row, motion in motions.items():
            poses.motions[int(row[1:])] = torch.tensor(motion)
    return poses


def test_nothing_moves_at_the_start_to_the_bit():
    data = FewViews()
    refined = RefinedCapture(data, refinement(data))
    for split in Split:
        for given, now in zip(data.views(split).cameras, refined.views(split).cameras, strict=True):
            assert torch.equal(given.world_to_camera, now.world_to_camera)


@pytest.mark.parametrize("size", [0.0, 1e-5, 1e-3, 1.0, 3.0])
def test_rotation_vectors_are_matrix_exponentials(size):
    vectors = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    vectors = size * torch.nn.functional.normalize(vectors, dim=1)
    x, y, z = vectors.unbind(1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).view(-1, 3, 3)
    found = rotation_vector_matrices(vectors)
    # Below the smallest angle, terms of the third order are left out.
    torch.testing.assert_close(found, torch.linalg.matrix_exp(cross), atol=1e-13, rtol=0)


def test_rotations_in_single_precision_are_rotations_however_small():
    for size in (1e-6, 1e-4, 1e-2):
        rotation = rotation_vector_matrices(torch.full((1, 3), size))[0]
        torch.testing.assert_close(rotation @ rotation.T, torch.eye(3), atol=3e-7, rtol=0)


def test_turning_about_the_pivot_leaves_it_in_place():
    motion = motion_matrices(
        torch.tensor([[0.1, 0.2, 0.3, 0.0, 0.0, 0.0]]), torch.tensor([2.5]), 4.0
    )
    pivot = torch.tensor([0.0, 0.0, 2.5, 1.0])
    torch.testing.assert_close(motion[0] @ pivot, pivot)


def test_translations_are_counted_in_extents():
    motion = motion_matrices(torch.tensor([[0.0, 0.0, 0.0, 0.5, 0.0, -1.0]]), torch.ones(1), 4.0)
    assert motion[0, :3, 3].tolist() == [2.0, 0.0, -4.0]


def test_gradients_by_motions_are_those_of_finite_differences():
    splats = random_splats(20, degree=1).map(torch.Tensor.double)
    view = around(0).to(dtype=torch.float64)
    weights = torch.rand(24, 32, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    depths = torch.tensor([3.0], dtype=torch.float64)

    def loss(motion):
        camera = replace(
            view, world_to_camera=motion_matrices(motion, depths, 1.0) @ view.world_to_camera
        )
        return (weights * ReferenceRasterizer().render(splats, camera).color[0]).sum()

    start = torch.full((1, 6), 0.01, dtype=torch.float64, requires_grad=True)
    loss(start).backward()
    for axis in range(6):
        step = torch.zeros(1, 6, dtype=torch.float64)
        step[0, axis] = 1e-6
        with torch.no_grad():
            difference = (loss(start + step) - loss(start - step)) / 2e-6
        assert float(start.grad[0, axis]) == pytest.approx(float(difference), rel=2e-4, abs=1e-4)


def test_scenes_without_points_have_their_extent_as_depth():
    data = FewViews()
    none = data.scene.points[:0]
    scene = replace(data.scene, points=none, point_colors=none)
    poses = torch.cat([camera.world_to_camera for camera in data.views(Split.TRAIN).cameras])
    assert scene_depths(poses, scene).tolist() == [scene.extent] * len(poses)


def test_views_with_one_pose_share_its_motion_and_held_out_ones_of_others_stay():
    data = FewViews(train=(0, 1, 0, 2), held=(1, 3))
    refined = RefinedCapture(
        data, refinement(data, p0=[0.1, 0, 0, 0, 0, 0], p1=[0, 0, 0, 0.1, 0, 0])
    )
    train, held = (refined.views(split).cameras for split in Split)
    assert torch.equal(train[0].world_to_camera, train[2].world_to_camera)
    assert not torch.equal(
        train[0].world_to_camera, data.views(Split.TRAIN).cameras[0].world_to_camera
    )
    assert torch.equal(held[0].world_to_camera, train[1].world_to_camera)
    assert torch.equal(held[1].world_to_camera, data.views(Split.EVAL).cameras[1].world_to_camera)


def test_cameras_of_batches_and_of_steps_are_the_refined_ones_and_steps_have_a_gradient():
    data = FewViews()
    poses = refinement(data, p1=[0.1, 0, 0, 0, 0, 0.2])
    refined = RefinedCapture(data, poses)
    (batch,) = refined.load(Split.TRAIN, [0, 1], CPU)
    wanted = torch.cat(
        [camera.world_to_camera for camera in refined.views(Split.TRAIN).cameras[:2]]
    )
    torch.testing.assert_close(batch.cameras.world_to_camera, wanted)
    assert not batch.cameras.world_to_camera.requires_grad
    (given,) = data.load(Split.TRAIN, [0, 1], CPU)
    in_a_step = poses.refine_by_number(given.cameras, torch.tensor([0, 1])).world_to_camera
    torch.testing.assert_close(in_a_step.detach(), wanted)
    in_a_step.sum().backward()
    assert poses.motions.grad[:2].abs().sum() > 0
    assert poses.motions.grad[2:].abs().sum() == 0


def test_motions_that_equal_a_similarity_of_the_world_are_taken_out():
    data = FewViews(train=range(6))
    size = 1e-3
    turn = rotation_vector_matrices(size * torch.tensor([[0.4, -0.7, 0.2]], dtype=torch.float64))[0]
    shift = size * torch.tensor([0.3, 0.5, -0.6], dtype=torch.float64)
    world = Similarity(1.0 + size, turn, shift)
    poses = PoseRefinement(data, RATE).double()
    given = torch.cat([camera.world_to_camera for camera in data.views(Split.TRAIN).cameras])
    # Depths grow with the world, and a picture does not change: the camera is what stays rigid.
    motion = world.camera(given) @ torch.linalg.inv(given.double())
    rotation = motion[:, :3, :3]
    angles = torch.stack([rotation[:, 2, 1], rotation[:, 0, 2], rotation[:, 1, 0]], dim=1)
    pivots = poses.depths[:, None] * torch.eye(3, dtype=torch.float64)[2]
    moved = motion[:, :3, 3] - pivots + (rotation @ pivots[..., None])[..., 0]
    with torch.no_grad():
        poses.motions.copy_(torch.cat([angles, moved / poses.extent], dim=1))
    assert float(poses.motions.detach().abs().max()) > 0.3 * size
    poses.project_()
    assert float(poses.motions.detach().abs().max()) < 20 * size**2


def test_other_motions_survive_and_projecting_twice_is_projecting_once():
    poses = PoseRefinement(FewViews(train=range(6)), RATE).double()
    generator = torch.Generator().manual_seed(5)
    with torch.no_grad():
        poses.motions.copy_(torch.randn(6, 6, generator=generator))
    before = float(poses.motions.detach().norm())
    poses.project_()
    once = poses.motions.detach().clone()
    assert 0.7 * before < float(once.norm()) < before
    poses.project_()
    torch.testing.assert_close(poses.motions.detach(), once)


@pytest.mark.parametrize(("views", "directions"), [(1, 6), (2, 7), (5, 7)])
def test_few_cameras_have_fewer_common_directions(views, directions):
    poses = torch.cat([around(i).world_to_camera for i in range(views)]).double()
    depths = torch.ones(views, dtype=torch.float64)
    basis = common_motions(poses, depths, 1.0)
    assert basis.shape == (6 * views, directions)
    identity = torch.eye(directions, dtype=torch.float64)
    torch.testing.assert_close(basis.T @ basis, identity)


def test_mean_motions_are_told_in_degrees_and_scene_units():
    data = FewViews(train=(0, 1))
    poses = refinement(data, p0=[math.radians(3), 0, 0, 0, 0.1, 0])
    assert poses.mean_angle == pytest.approx(1.5)
    assert poses.mean_shift == pytest.approx(0.05 * data.scene.extent)
