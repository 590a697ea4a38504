"""Exposure from points that images share."""

import numpy as np
from support.track_observations import exposed, observed

from gsfw.preparation.check.track_exposure import FEWEST, TrackExposure


def fitted(colors):
    return TrackExposure.of(colors.points, colors.views, colors.colors)


def test_known_gains_and_offsets_are_found_up_to_their_mean():
    colors, gains, offsets = exposed(observed())
    found = fitted(colors)
    true = gains / gains.mean(0)
    np.testing.assert_allclose(found.gains, true, atol=0.03)
    np.testing.assert_allclose(found.offsets, offsets - true * offsets.mean(0), atol=0.015)


def test_images_of_one_exposure_are_left_alone():
    found = fitted(observed())
    np.testing.assert_allclose(found.gains, 1, atol=0.03)
    np.testing.assert_allclose(found.offsets, 0, atol=0.015)


def test_highlights_and_clipped_colours_do_not_move_it():
    colors, gains, _ = exposed(observed())
    spoilt = colors.colors.copy()
    spoilt[::9] = 1.0
    spoilt[4::9] += 0.3
    found = TrackExposure.of(colors.points, colors.views, spoilt)
    np.testing.assert_allclose(found.gains, gains / gains.mean(0), atol=0.1)


def test_an_image_with_few_points_keeps_its_exposure():
    colors, *_ = exposed(observed())
    last = colors.views.max()
    rare = np.flatnonzero(colors.views == last)[FEWEST - 1 :]
    kept = np.delete(np.arange(len(colors.views)), rare)
    found = TrackExposure.of(colors.points[kept], colors.views[kept], colors.colors[kept])
    assert (found.gains[last] == 1).all()
    assert (found.offsets[last] == 0).all()
    assert (found.gains[:last] != 1).all()


def test_an_image_of_one_colour_keeps_its_exposure_and_spoils_no_other():
    colors, gains, _ = exposed(observed())
    fog = colors.views == 3
    flat = colors.colors.copy()
    flat[fog] = 0.5
    found = TrackExposure.of(colors.points, colors.views, flat)
    assert (found.gains[3] == 1).all()
    assert (found.offsets[3] == 0).all()
    others = np.arange(len(gains)) != 3
    true = gains[others] / gains[others].mean(0)
    np.testing.assert_allclose(found.gains[others], true, atol=0.05)
    alike = TrackExposure.of(colors.points, colors.views, np.full_like(flat, 0.5))
    assert (alike.gains == 1).all()
