"""What times show."""

import json
import shutil

import numpy as np
import pytest
from support.checked_captures import moving_findings, write_moving

from gsfw.preparation.finding import Weight

EVEN = np.linspace(0, 1, 8).tolist()
KINDS = {
    "few times",
    "gaps in time",
    "one camera at each time",
    "two cameras at each time",
    "hardly anything moves",
    "held-out times not trained",
}


def time_kinds(folder):
    return set(moving_findings(folder)) & KINDS


def test_cameras_that_stand_around_what_moves_are_fine(tmp_path):
    found = moving_findings(write_moving(tmp_path / "a", EVEN, 4))
    assert not set(found) & KINDS
    assert "copies" not in found
    assert found["few views"].found == "32 images to train on from 4 places."


def test_few_times_and_gaps_are_told(tmp_path):
    assert "few times" in time_kinds(write_moving(tmp_path / "a", [0.0, 0.5, 1.0], 4))
    gap = [0.0, 0.1, 0.2, 0.3, 0.8, 0.9, 1.0]
    found = moving_findings(write_moving(tmp_path / "b", gap, 4))["gaps in time"]
    assert "the longest from 0.3 to 0.8" in found.found


def test_how_many_cameras_see_a_time_is_told(tmp_path):
    assert "two cameras at each time" in time_kinds(write_moving(tmp_path / "a", EVEN, 2))
    assert "one camera at each time" in time_kinds(write_moving(tmp_path / "b", EVEN, 1))


def test_a_scene_that_stands_still_is_told(tmp_path):
    found = moving_findings(write_moving(tmp_path / "a", EVEN, 4, moves=0.0))
    assert "ignore_time=true" in found["hardly anything moves"].advice


@pytest.mark.slow
def test_times_that_belong_to_other_images_are_told(tmp_path):
    times = [number / 15 for number in range(16)]
    folder = write_moving(tmp_path / "a", times, 2, moves=0.5)
    assert "times out of order" not in moving_findings(folder)
    file = folder / "transforms_train.json"
    document = json.loads(file.read_text())
    mixed = np.random.default_rng(3).permutation(times)
    for frame in document["frames"]:
        frame["time"] = float(mixed[times.index(frame["time"])])
    file.write_text(json.dumps(document))
    found = moving_findings(folder)["times out of order"]
    assert found.weight is Weight.STOP


@pytest.mark.parametrize(("start", "found"), [(0.0, False), (1.0, True)])
def test_held_out_views_beyond_the_trained_times_are_told(start, found, tmp_path):
    folder = write_moving(tmp_path / "a", EVEN, 4)
    held = json.loads((folder / "transforms_train.json").read_text())
    held["frames"] = [
        {**frame, "time": frame["time"] + start} for frame in held["frames"] if frame["time"] < 0.5
    ]
    (folder / "test").mkdir()
    for frame in held["frames"]:
        name = frame["file_path"].replace("train", "test")
        shutil.copy(folder / f"{frame['file_path']}.png", folder / f"{name}.png")
        frame["file_path"] = name
    (folder / "transforms_test.json").write_text(json.dumps(held))
    findings = moving_findings(folder)
    assert ("held-out times not trained" in findings) == found
    if found:
        assert findings["held-out times not trained"].found == (
            "4 of 16 held-out views are at times from 1.429 to 1.429; the trained ones are from "
            "0 to 1."
        )
