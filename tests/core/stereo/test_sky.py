"""The sky: directions in which views agree at infinite distance."""

from dataclasses import replace

import pytest
import torch
from support.outdoors import sky_color, views_of_the_sky

from gsfw.core.sky import SKY_EXTENTS, Sky, empty_sky
from gsfw.core.stereo import sky
from gsfw.core.stereo.sky import even_directions, found_sky
from gsfw.core.stereo.views import StereoViews

CENTERS = torch.tensor([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
NONE = torch.zeros(0, 3)


def sphere() -> Sky:
    return empty_sky(CENTERS, 1.5, NONE)


def test_directions_are_evenly_spread_over_the_sphere():
    directions = even_directions(2000)
    assert torch.allclose(directions.norm(dim=1), torch.ones(2000, dtype=torch.float64))
    nearest = (directions @ directions.T - 2 * torch.eye(2000)).amax(1).acos()
    assert nearest.max() / nearest.min() < 1.5
    assert directions.mean(0).abs().max() < 1e-3


def test_the_sky_is_found_above_the_wall_and_has_its_colours(monkeypatch):
    monkeypatch.setattr(sky, "PIXELS_APART", 2.0)
    found = found_sky(views_of_the_sky(), sphere())
    assert isinstance(found, Sky)
    directions = (found.points - found.center) / found.radius
    assert torch.allclose(directions.norm(dim=1), torch.ones(len(found)))
    assert (directions[:, 1] < 0.03).float().mean() > 0.98  # Some waves may meet.
    # The upper half of an image of 48 x 36 pixels has a direction for every 2 x 2 of them.
    assert 150 < len(found) < 250
    above = directions[:, 1] < 0.0
    expected = torch.from_numpy(sky_color(directions[above].numpy())).float()
    assert (found.colors[above] - expected).abs().max() < 0.03


def test_two_places_that_disagree_see_no_sky(monkeypatch):
    monkeypatch.setattr(sky, "PIXELS_APART", 2.0)
    views = views_of_the_sky(2)
    black, white = (torch.full_like(views.colors[0], value) for value in (0.0, 1.0))
    found = found_sky(replace(views, colors=(black, white)), sphere())
    assert found == "cameras agree on 0 of 5,027 directions"


def test_masked_pixels_do_not_vote(monkeypatch):
    monkeypatch.setattr(sky, "PIXELS_APART", 2.0)
    views = views_of_the_sky()
    everything = tuple(torch.ones_like(unknown) for unknown in views.unknown)
    assert found_sky(replace(views, unknown=everything), sphere()) == (
        "cameras agree on 0 of 5,027 directions"
    )


@pytest.mark.parametrize("count", [0, 1])
def test_one_view_cannot_tell_a_sky_from_a_wall(count):
    few = views_of_the_sky(count)
    assert (
        found_sky(few, sphere()) == f"it takes pinhole cameras at 2 places, and there are {count}"
    )


def test_a_camera_that_films_from_one_place_has_one_vote(monkeypatch):
    """Else all that does not move would be the sky."""
    monkeypatch.setattr(sky, "PIXELS_APART", 2.0)
    views = views_of_the_sky(3)
    first, *others = range(3)
    rows = [first] * 20 + others
    films = StereoViews(
        tuple(views.colors[row] for row in rows),
        views.world_to_camera[rows],
        views.intrinsics[rows],
        tuple(views.empty[row] for row in rows),
        tuple(views.unknown[row] for row in rows),
    )
    found, expected = found_sky(films, sphere()), found_sky(views, sphere())
    assert isinstance(found, Sky)
    assert isinstance(expected, Sky)
    assert torch.equal(found.points, expected.points)


def test_the_sky_is_behind_all_but_stray_points():
    assert sphere().radius == pytest.approx(SKY_EXTENTS * 1.5)
    points = torch.zeros(1000, 3)
    points[:20, 0], points[0, 0] = 101.0, 1e6
    assert empty_sky(CENTERS, 1.5, points).radius == pytest.approx(200.0)


def test_positions_beyond_half_of_the_radius_are_the_sky():
    places = torch.tensor([[1.0, 0.0, 0.0], [1.0, 14.0, 0.0], [1.0, 16.0, 0.0]])
    assert sphere().holds(places).tolist() == [False, False, True]
