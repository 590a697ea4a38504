"""Transforms compose, have inverses, and take view-dependent colours and cameras with them."""

import math
from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.maths.axes import axis_vector
from gsfw.core.maths.frame import transform_splats
from gsfw.core.render_settings import RenderSettings
from gsfw.editing import transforms
from gsfw.editing.transforms import composed, move, rotate, scale
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SOME = composed(
    move(torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)),
    composed(rotate(torch.tensor([1.0, 2.0, -1.0], dtype=torch.float64), 57.0), scale(1.7)),
)


def image(splats, camera):
    settings = RenderSettings(background=torch.full((3,), 0.3, dtype=torch.float64))
    return ReferenceRasterizer().render(splats, camera, settings).color


def test_a_rotation_is_right_handed():
    turned = rotate(axis_vector("z"), 90.0).apply(axis_vector("x"))
    assert torch.allclose(turned, axis_vector("y"))
    turned = rotate(torch.tensor([0.0, 0.0, -3.0], dtype=torch.float64), 90.0).apply(
        axis_vector("x")
    )
    assert torch.allclose(turned, axis_vector("-y"))


def test_composed_applies_the_first_one_first():
    point = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    first, second = rotate(axis_vector("x"), 30.0), move(axis_vector("y"))
    assert torch.allclose(
        composed(second, first).apply(point), second.apply(first.apply(point)), atol=1e-15
    )


def test_a_transform_and_its_inverse_render_the_same():
    splats = random_splats(40, 3, dtype=torch.float64)
    camera = front_camera(48, 36, dtype=torch.float64)
    there = transform_splats(splats, SOME)
    back = transform_splats(there, SOME.inverse())
    before, after = image(splats, camera), image(back, camera)
    assert float(before.std()) > 0.03
    assert float((before - after).abs().max()) < 1e-12


def test_transformed_splats_look_the_same_from_transformed_cameras_with_their_harmonics():
    splats = random_splats(40, 3, dtype=torch.float64)
    camera = front_camera(48, 36, dtype=torch.float64)
    moved = replace(camera, world_to_camera=SOME.camera(camera.world_to_camera))
    before = image(splats, camera)
    assert float((before - image(transform_splats(splats, SOME), moved)).abs().max()) < 1e-9
    unturned = replace(transform_splats(splats, SOME), colors=splats.colors)
    assert float((before - image(unturned, moved)).abs().max()) > 0.01


@pytest.mark.parametrize("pair", [("x", "z"), ("x", "-x"), ("z", "-z"), ("y", "y")])
def test_the_rotation_between_two_directions_turns_one_into_the_other(pair):
    start, end = map(axis_vector, pair)
    rotation = transforms.rotation_between(start, end)
    assert torch.allclose(rotation @ start, end, atol=1e-12)
    assert float(torch.linalg.det(rotation)) == pytest.approx(1)
    turn = math.degrees(math.acos(min(1, (float(rotation.trace()) - 1) / 2)))
    assert turn == pytest.approx({0: 90, 1: 0, -1: 180}[round(float(start @ end))], abs=1e-4)


def test_the_upward_axis_of_a_file_follows_quarter_turns_and_is_forgotten_after_others():
    assert transforms.up_after("z", rotate(axis_vector("x"), 90.0)) == "-y"
    assert transforms.up_after("-y", scale(3.0)) == "-y"
    assert transforms.up_after("z", rotate(axis_vector("x"), 30.0)) == ""
    for unknown in ("", "Y-up"):
        assert transforms.up_after(unknown, scale(3.0)) == ""


def test_transforms_without_a_meaning_are_refused():
    with pytest.raises(ValueError, match="no length"):
        rotate(torch.zeros(3, dtype=torch.float64), 30.0)
    with pytest.raises(ValueError, match="expected a positive number"):
        scale(0.0)
