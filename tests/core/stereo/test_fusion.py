"""Fusion: what views confirm, once each."""

from dataclasses import replace

import torch
from support.textured_plane import DEPTH, HEIGHT, WIDTH, views_of_a_plane

from gsfw.core.stereo.fusion import FusedImage, FusionRule, fuse_views

FLAT = torch.full((HEIGHT, WIDTH), DEPTH)
OTHERS = [[1, 2], [0, 2], [0, 1]]


def kept(found: list[FusedImage]) -> int:
    return sum(int(image.kept.sum()) for image in found)


def test_points_that_views_agree_on_lie_where_their_depths_are():
    found = fuse_views(views_of_a_plane(), [FLAT] * 3, OTHERS, FusionRule())
    points = torch.cat([image.points[image.kept] for image in found])
    assert len(points) > 1000
    assert torch.allclose(points[:, 2], torch.full_like(points[:, 2], DEPTH), atol=1e-5)


def test_a_place_that_three_views_show_becomes_one_point():
    views = views_of_a_plane()
    shared = (WIDTH - 8) * HEIGHT
    assert abs(kept(fuse_views(views, [FLAT] * 3, OTHERS, FusionRule())) - shared) < 0.02 * shared


def test_the_view_that_shows_a_place_most_closely_represents_it():
    views = views_of_a_plane()
    nearer = views.intrinsics.clone()
    nearer[2, :2] *= 1.01
    found = fuse_views(replace(views, intrinsics=nearer), [FLAT] * 3, OTHERS, FusionRule())
    assert int(found[2].kept.sum()) > 0.9 * kept(found)


def test_a_depth_that_no_other_view_has_is_left_out():
    wrong = torch.full_like(FLAT, 1.2 * DEPTH)
    found = fuse_views(views_of_a_plane(), [FLAT, wrong, FLAT], OTHERS, FusionRule())
    assert kept(found) == 0
    one = FusionRule(confirmations=1)
    assert kept(fuse_views(views_of_a_plane(), [FLAT, wrong, FLAT], OTHERS, one)) > 1000


def test_points_that_views_see_through_are_left_out():
    views = views_of_a_plane(5)
    others = [[j for j in range(5) if j != i] for i in range(5)]
    seen = kept(fuse_views(views, [FLAT] * 5, others, FusionRule()))
    empty = tuple(torch.full_like(each, i > 2) for i, each in enumerate(views.empty))
    rest = kept(fuse_views(replace(views, empty=empty), [FLAT] * 5, others, FusionRule()))
    assert rest < 0.7 * seen


def test_pixels_without_a_depth_give_no_points():
    assert kept(fuse_views(views_of_a_plane(), [FLAT * 0] * 3, OTHERS, FusionRule())) == 0
