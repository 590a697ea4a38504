"""Colours of matched points, looked up in images."""

import numpy as np
import pytest
from PIL import Image
from support.checked_captures import BALL, pattern, write_ball
from support.tracked_ball import SLANT, track_ball

from gsfw.core.datamanager import DataRequest
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.preparation.check.track_colors import MIN_VIEWS, TrackColors
from gsfw.preparation.check.viewpoints import Viewpoints


def sampled(folder, views=None, **request):
    """What is looked up in some views, and where the points are in the world."""
    data = ColmapConfig().build(DataRequest(folder, **request))
    viewpoints = Viewpoints.of(data)
    colors = TrackColors.of(data, viewpoints, range(len(viewpoints)) if views is None else views)
    data.close()
    return colors, data.recording.points.numpy()[colors.rows]


def test_colours_are_those_of_the_surface(tmp_path):
    track_ball(tmp_path / "a")
    colors, places = sampled(tmp_path / "a")
    assert len(colors.rows) > 300
    off = colors.colors - pattern(places)[colors.points]
    # A Gaussian of 1.5 pixels flattens this pattern by a tenth.
    assert np.abs(off).mean() < 0.04
    assert np.bincount(colors.points).min() >= MIN_VIEWS


def test_directions_lead_from_the_camera_to_the_point(tmp_path):
    capture = track_ball(tmp_path / "a").capture
    colors, places = sampled(tmp_path / "a", eval_every_nth=0)
    centers = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in capture.poses])
    rays = places[colors.points] - centers[colors.views]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cosines = (rays * places[colors.points]).sum(1) / BALL
    assert (cosines < -0.9 * SLANT).all()
    np.testing.assert_allclose((colors.directions**2).sum(1), 1)


def test_a_misplaced_point_varies_by_the_slope_of_its_texture(tmp_path):
    track_ball(tmp_path / "a", error=1.0)
    track_ball(tmp_path / "b", error=2.0)
    one, two = sampled(tmp_path / "a")[0].misplaced, sampled(tmp_path / "b")[0].misplaced
    np.testing.assert_allclose(two, 4 * one)
    # The pattern has slopes up to 0.35 * 20 per unit of length; about 70 pixels are one.
    assert 0.02 < np.sqrt(np.median(one)) < 0.35 * 20 / 60


def test_only_views_that_are_asked_for_are_looked_at(tmp_path):
    track_ball(tmp_path / "a")
    colors, _ = sampled(tmp_path / "a", range(24))
    assert set(colors.views) == set(range(24))


@pytest.mark.parametrize("views", [[], [0, 1, 2]])
def test_points_in_too_few_views_are_left_out(tmp_path, views):
    track_ball(tmp_path / "a")
    assert len(sampled(tmp_path / "a", views)[0].points) == 0


def test_at_most_so_many_points_are_measured_and_always_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.preparation.check.track_colors.MAX_POINTS", 100)
    track_ball(tmp_path / "a")
    first, _ = sampled(tmp_path / "a")
    second, _ = sampled(tmp_path / "a")
    assert 50 < len(first.rows) <= 100
    assert np.array_equal(first.rows, second.rows)


def test_what_masks_hide_is_not_looked_at(tmp_path):
    folder = track_ball(tmp_path / "a").folder
    seen = len(sampled(folder)[0].points)
    (folder / "masks").mkdir()
    for view in range(48):
        mask = np.full((48, 64), 255, np.uint8)
        mask[:24] = 0
        Image.fromarray(mask).save(folder / "masks" / f"view_{view:03d}.png")
    assert 0 < len(sampled(folder)[0].points) < 0.7 * seen


def test_data_without_tracks_has_no_colours(tmp_path):
    write_ball(tmp_path / "a")
    assert len(sampled(tmp_path / "a")[0].rows) == 0
