"""Points over pictures, coloured by degree."""

import numpy as np
from support.checked_captures import write_ball
from support.tracked_ball import track_ball

from gsfw.preparation.check.contact_sheet import COLORS, degree_strip


def count(strip, color):
    return int((np.abs(np.asarray(strip).astype(int) - color).max(2) < 12).sum())


def test_points_of_a_matte_ball_are_drawn_as_matte(tmp_path):
    survey = track_ball(tmp_path / "a").survey()
    assert survey.view_dependence.shares[0] > 0.8
    strip = degree_strip(survey, 1200)
    assert strip.width == 1200
    assert count(strip, COLORS[0]) > 5 * count(strip, COLORS[2])


def test_without_tracks_there_is_no_strip(tmp_path):
    survey = write_ball(tmp_path / "a").survey()
    assert survey.view_dependence is None
    assert degree_strip(survey, 1200) is None
