"""Alignment finds gravity in tilted captures, the floor under what stands on it, and true sizes."""

import math
from dataclasses import replace

import pytest
import torch

from gsfw.core.cameras import Cameras
from gsfw.core.maths.axes import axis_vector
from gsfw.editing import alignment
from gsfw.editing.transforms import rotate

TILT = rotate(torch.tensor([1.0, 0.4, 0.2], dtype=torch.float64), 23.0)
UP = TILT.rotation @ axis_vector("z")


def degrees_apart(first, second):
    return math.degrees(math.acos(min(1.0, float(first @ second))))


def tilted_cameras(arc=360.0, count=12):
    """Level cameras that look down at the middle, in a world that is tilted."""
    angles = torch.linspace(0, math.radians(arc), count + 1, dtype=torch.float64)[:-1]
    places = torch.stack([3 * angles.cos(), 3 * angles.sin(), 1 + 0.3 * angles], dim=1)
    cameras = Cameras.look_at(places, width=32, height=24, up=axis_vector("z"))
    cameras = replace(cameras, world_to_camera=TILT.camera(cameras.world_to_camera))
    return tuple(cameras.select([index]) for index in range(count))


@pytest.mark.parametrize("arc", [360.0, 60.0])
def test_level_cameras_know_which_way_is_up_though_they_look_down(arc):
    assert degrees_apart(alignment.up_of_cameras(tilted_cameras(arc)), UP) < 1e-4


def test_cameras_that_face_one_way_give_the_mean_of_their_own():
    camera = tilted_cameras()[0]
    up = alignment.up_of_cameras((camera, camera))
    assert torch.allclose(up, -camera.world_to_camera[0, 1, :3])


def room(count=4000):
    """A floor with a box on it, a wall, a ceiling, and a few reflections below; and opacities."""
    generator = torch.Generator().manual_seed(3)

    def draw(n):
        return torch.rand(n, 3, generator=generator, dtype=torch.float64) * 2 - 1

    floor, wall, ceiling, box, below = (draw(n) for n in (count, count, count, count, count // 20))
    floor[:, 2] = 0.002 * draw(count)[:, 2]
    wall[:, 0] = 1.0
    ceiling[:, 2] = 1.0
    wall[:, 2] = (wall[:, 2] + 1) / 2
    box = 0.3 * box + torch.tensor([0.2, 0.1, 0.3])
    below[:, 2] = -0.5 - 0.3 * below[:, 2].abs()
    points = torch.cat([floor, wall, ceiling, box, below])
    return TILT.apply(points) + torch.tensor([5.0, -3, 2]), torch.full((len(points),), 0.9)


def test_the_floor_of_a_tilted_room_is_found_and_not_its_ceiling():
    points, opacities = room()
    hint = rotate(torch.tensor([0.0, 1, 0], dtype=torch.float64), 20.0).rotation @ UP
    found = alignment.fit_floor(points, opacities, hint)
    assert degrees_apart(found.normal, UP) < 0.1
    middle = torch.tensor([5.0, -3, 2], dtype=torch.float64)
    assert found.height == pytest.approx(float(found.normal @ middle), abs=0.003)
    level = alignment.fit_floor(points, opacities, UP, 0.0)
    assert torch.equal(level.normal, UP)
    assert level.height == pytest.approx(float(UP @ middle), abs=0.003)
    again = alignment.fit_floor(points, opacities, hint)
    assert torch.equal(again.normal, found.normal)


def test_faint_splats_are_no_floor():
    points, opacities = room()
    opacities[:4000] = 0.05
    with pytest.raises(ValueError, match="2 splats are opaque, and a floor needs three"):
        alignment.fit_floor(points[:4002], opacities[:4002], UP)


def test_a_cloud_has_no_floor():
    generator = torch.Generator().manual_seed(0)
    points = torch.randn(3000, 3, generator=generator, dtype=torch.float64)
    with pytest.raises(ValueError, match="no plane within 40 degrees"):
        alignment.fit_floor(points, torch.ones(3000), axis_vector("z"))


def test_the_true_size_is_exact():
    start, end = (torch.tensor(p, dtype=torch.float64) for p in ([1.0, 2, 3], [1.0, 5, 7]))
    similarity = alignment.true_size(start, end, 1.25)
    moved = similarity.apply(torch.stack([start, end]))
    assert float((moved[1] - moved[0]).norm()) == pytest.approx(1.25, rel=1e-15)
    with pytest.raises(ValueError, match="two points are the same"):
        alignment.true_size(start, start, 1.0)
