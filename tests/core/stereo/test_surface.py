"""Surface points: from images and cameras to points."""

from dataclasses import replace

import pytest
import torch
from support.textured_plane import DEPTH, HEIGHT, WIDTH, views_of_a_plane

from gsfw.core.operators import Operators
from gsfw.core.stereo.surface import SurfacePoints, surface_points

NONE = torch.empty(0, 3)


def test_points_lie_on_the_plane_and_have_its_colours():
    views = views_of_a_plane()
    found = surface_points(views, NONE, (2.0, 10.0), Operators())
    assert len(found) > 800
    assert found.confirmed > 0.5
    assert ((found.points[:, 2] - DEPTH).abs() < 0.03 * DEPTH).float().mean() > 0.97
    pixels, _, inside = views.project(1, found.points.double())
    at = pixels[inside].long()
    near = (views.colors[1][at[:, 1], at[:, 0]] - found.colors[inside]).abs().mean()
    assert near < 0.05


def test_known_points_tell_how_far_surfaces_are():
    known = torch.rand(200, 3) * 2.0 - 0.5
    known[:, 2] = DEPTH
    found = surface_points(views_of_a_plane(), known, (50.0, 100.0), Operators())
    assert len(found) > 800


def test_two_views_suffice():
    found = surface_points(views_of_a_plane(2), NONE, (2.0, 10.0), Operators())
    assert len(found) > 800


def test_views_from_one_place_give_no_points():
    assert len(surface_points(views_of_a_plane(3, step=0.0), NONE, (2.0, 10.0), Operators())) == 0


@pytest.mark.slow
def test_masked_and_empty_pixels_give_no_points():
    views, top = views_of_a_plane(), torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    top[: HEIGHT // 2] = True
    for hidden in (replace(views, unknown=(top,) * 3), replace(views, empty=(top,) * 3)):
        found = surface_points(hidden, NONE, (2.0, 10.0), Operators())
        assert len(found) > 300
        assert found.points[:, 1].min() > -0.2


def test_thinning_keeps_more_points_where_the_image_changes():
    contrasts = torch.cat([torch.zeros(500), torch.full((500,), 0.45)])
    points = SurfacePoints(torch.rand(1000, 3), torch.rand(1000, 3), contrasts, 1.0)
    few = points.thinned(110)
    assert len(few) == 110
    assert (few.contrasts > 0).sum() == 100
    assert len(points.thinned(2000)) == 1000
