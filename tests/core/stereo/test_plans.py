"""Sweep plans: which views are neighbours, and between which depths they are compared."""

import pytest
import torch
from support.textured_plane import DEPTH, views_of_a_plane

from gsfw.core.stereo.plans import (
    LEAST_PLANES,
    MARGIN,
    MOST_PLANES,
    SeenPlaces,
    assumed_places,
    depth_ranges,
    neighbors_of,
    seen_places,
    sweep_plans,
)

PLANE = torch.cat([torch.rand(200, 2).double() * 2 - 0.5, torch.full((200, 1), DEPTH)], dim=1)


def test_the_neighbours_at_the_best_angle_come_first():
    views = views_of_a_plane(9, step=0.1)
    (first, *_) = neighbors_of(views, seen_places(views, PLANE), 4)
    assert first[0] in (4, 5, 6)
    assert len(first) == 4


def test_views_from_one_place_have_no_neighbours():
    views = views_of_a_plane(4, step=0.0)
    assert neighbors_of(views, seen_places(views, PLANE), 4) == [[]] * 4
    assert sweep_plans(views, [[]] * 4, [(1.0, 2.0)] * 4) == []


def test_views_that_see_other_places_are_no_neighbours():
    views = views_of_a_plane(3, step=4.0)
    assert neighbors_of(views, seen_places(views, PLANE), 4) == [[]] * 3


def test_planes_reach_somewhat_beyond_the_places():
    near, far = depth_ranges(seen_places(views_of_a_plane(), PLANE), (0.1, 100.0))[0]
    assert near == pytest.approx(DEPTH / MARGIN)
    assert far == pytest.approx(DEPTH * MARGIN)


def test_a_view_that_sees_few_places_takes_the_range_of_all():
    none = SeenPlaces(torch.empty(0, 3).double(), torch.empty(0).double())
    some = SeenPlaces(PLANE, torch.linspace(1.0, 5.0, 200).double())
    ranges = depth_ranges([none, some], (0.1, 100.0))
    assert ranges[0] == pytest.approx(ranges[1])
    assert depth_ranges([none], (0.1, 100.0)) == [(0.1 / MARGIN, 100.0 * MARGIN)]


def test_assumed_places_lie_between_the_depths():
    views = views_of_a_plane()
    for each in assumed_places(views, 1.0, 9.0):
        assert each.depths.min() > 1.0
        assert each.depths.max() < 9.0


def test_planes_follow_how_far_a_place_is_shifted():
    views, others = views_of_a_plane(), [[1], [0], [0]]
    (wide, _, wider) = sweep_plans(views, others, [(0.4, 100.0)] * 3)
    assert LEAST_PLANES < wide.planes < wider.planes <= MOST_PLANES
    (narrow, _, _) = sweep_plans(views, others, [(4.0, 4.1)] * 3)
    assert narrow.planes == LEAST_PLANES
