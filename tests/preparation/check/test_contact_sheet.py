"""The contact sheet."""

import numpy as np
import pytest
from PIL import Image
from support.checked_captures import ball, with_points, write_ball
from support.tracked_ball import track_ball

from gsfw.preparation.check.camera_findings import camera_findings
from gsfw.preparation.check.contact_sheet import (
    COLORS,
    WIDTH,
    Tile,
    degree_strip,
    tiles_of,
    write_contact_sheet,
)
from gsfw.preparation.check.examination import judge
from gsfw.preparation.check.map_view import HELD_OUT, TRAINED, map_views
from gsfw.preparation.finding import Verdict, Weight


def sheet_of(survey, path):
    findings = judge(survey)
    tiles = tiles_of(survey, findings, 12, 6)
    write_contact_sheet(path, survey.scene.name, Verdict.of(findings), survey, tiles)
    return np.asarray(Image.open(path))


def count(pixels, color):
    return int((np.abs(np.asarray(pixels).astype(int) - color).max(2) < 12).sum())


@pytest.mark.slow
def test_a_sheet_shows_cameras_of_both_splits_and_points(tmp_path):
    survey = write_ball(tmp_path / "a").survey()
    pixels = sheet_of(survey, tmp_path / "check.png")
    assert pixels.shape[1] == WIDTH
    maps = pixels[80:500]
    assert count(maps, TRAINED) > 300
    assert count(maps, HELD_OUT) > 50


def test_names_with_line_ends_are_drawn_in_one_line(tmp_path):
    tiles = [Tile("a\nb.png", "", Weight.NOTE, None)]
    for name in ("a\nb", "a b"):
        write_contact_sheet(tmp_path / f"{name}.png", name, Verdict.GOOD, None, tiles)
    assert (tmp_path / "a\nb.png").read_bytes() == (tmp_path / "a b.png").read_bytes()


def test_above_and_side_are_at_right_angles_to_up(tmp_path):
    above, side, how = map_views(write_ball(tmp_path / "a").survey())
    assert how == "up as the cameras are held"  # COLMAP says -y, whatever way is up.
    np.testing.assert_allclose(above.across, side.across)
    np.testing.assert_allclose([above.across @ side.down, above.down @ side.down], 0, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_captures_of_hardly_anything_are_drawn(tmp_path, count):
    capture = with_points(ball(count=count), np.zeros((0, 3)))
    written = write_ball(tmp_path / "a", capture)
    from gsfw.core.datamanager import DataRequest
    from gsfw.datamanagers.colmap.config import ColmapConfig
    from gsfw.preparation.check.survey import Survey

    data = ColmapConfig().build(DataRequest(written.folder, eval_every_nth=0))
    survey = Survey.of(data)
    data.close()
    assert list(camera_findings(survey))
    sheet_of(survey, tmp_path / "check.png")


@pytest.mark.slow
def test_images_to_look_at_are_on_the_sheet_even_if_they_do_not_decode(tmp_path):
    written = write_ball(tmp_path / "a")
    before = sheet_of(written.survey(), tmp_path / "good.png")
    path = written.folder / "images" / "view_004.png"
    path.write_bytes(path.read_bytes()[:2000])
    after = sheet_of(written.survey(), tmp_path / "bad.png")
    assert (before[540:] != after[540 : len(before)]).any()


def test_a_capture_without_cameras_has_a_sheet_of_its_images(tmp_path):
    image = Image.new("RGB", (40, 30), (200, 30, 30))
    tiles = [
        Tile("a.jpg", "blurred", Weight.LIMIT, image),
        Tile("b.jpg", "does not decode", Weight.LIMIT, None, "does not decode"),
    ]
    write_contact_sheet(tmp_path / "a.png", "a", Verdict.WILL_NOT_TRAIN, None, tiles)
    pixels = np.asarray(Image.open(tmp_path / "a.png"))
    assert len(pixels) < 400
    assert count(pixels, (200, 30, 30)) == 40 * 30


@pytest.mark.slow
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
