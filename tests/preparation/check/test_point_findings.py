"""What points show, and how images agree with them."""

from dataclasses import replace

import numpy as np
import pytest
from support.checked_captures import ball, with_points, write_ball

from gsfw.preparation.check import point_findings
from gsfw.preparation.check.agreement import scatter_by_chance
from gsfw.preparation.finding import Weight

RANDOM = np.random.default_rng(0)
USUAL = ball().points


def found_with(folder, points):
    return write_ball(folder / "a", with_points(ball(), points)).findings(1)


@pytest.mark.parametrize(
    ("kind", "points"),
    [
        ("few points", USUAL[:200]),
        ("coincident points", np.concatenate([USUAL, USUAL[:500]])),
        ("points far out", np.concatenate([USUAL, 1000 * RANDOM.normal(size=(60, 3))])),
        ("scene far away", 2 * USUAL - [100.0, 0.0, 0.0]),
        ("scene tiny", USUAL / 200),
    ],
)
def test_points_that_are_no_start_are_told(tmp_path, kind, points):
    assert found_with(tmp_path, points)[kind].weight is Weight.LIMIT


def test_points_at_cameras_are_told(tmp_path):
    centers = [-pose[:3, :3].T @ pose[:3, 3] for pose in ball().poses]
    near = np.repeat(centers, 5, axis=0) + 1e-3 * RANDOM.normal(size=(120, 3))
    assert "points at cameras" in found_with(tmp_path, np.concatenate([USUAL, near]))


def test_cameras_that_look_away_from_all_points_do_not_train(tmp_path):
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    capture = ball()
    flipped = replace(capture, poses=[turned @ pose for pose in capture.poses])
    found = write_ball(tmp_path / "a", flipped).findings(1)["cameras see no points"]
    assert found.weight is Weight.STOP
    assert "100 % of the points are behind the cameras" in found.why
    assert found.advice.startswith("Check axes (OpenCV or OpenGL)")


def test_one_camera_that_looks_away_is_named(tmp_path):
    capture = ball()
    capture.poses[5] = np.diag([1.0, -1.0, -1.0, 1.0]) @ capture.poses[5]
    found = write_ball(tmp_path / "a", capture).findings(1)["cameras see no points"]
    assert (found.weight, found.images) == (Weight.LIMIT, ("view_005.png",))


@pytest.mark.slow
def test_images_in_another_order_contradict_the_points(tmp_path):
    written = write_ball(tmp_path / "a")
    assert written.survey().agreement.scatter < 0.2
    names = written.capture.names
    images = [(written.folder / "images" / name).read_bytes() for name in names]
    for name, image in zip(names, reversed(images), strict=True):
        (written.folder / "images" / name).write_bytes(image)
    assert "images contradict points" in written.findings()


@pytest.mark.slow
def test_colors_that_scatter_less_than_by_chance_contradict_no_points(tmp_path, monkeypatch):
    """So those of sharp texture in few images, whose scatter alone may exceed the threshold."""
    written = write_ball(tmp_path / "a")
    survey = written.survey()
    scatter = survey.agreement.scatter
    chance = scatter_by_chance(survey.surface, survey.viewpoints, survey.sample)
    assert scatter < 0.5 * chance
    monkeypatch.setattr(point_findings, "SCATTER", scatter / 2)
    assert "images contradict points" not in written.findings()


def test_no_points_is_a_note_where_cameras_look_at_one_point(tmp_path):
    found = write_ball(tmp_path / "a", with_points(ball(), np.zeros((0, 3)))).findings(1)
    assert found["no points"].weight is Weight.NOTE
    assert "random_region=object" in found["no points"].advice
