"""`gsfw check`."""

import json
import re

import numpy as np
import pytest
from support.checked_captures import ball, write_ball, write_moving
from support.tracked_ball import track_ball

from gsfw.commands.main import main


def check(capsys, *tokens, code=0):
    """The document, with the exit code that is expected."""
    assert main(["check", *map(str, tokens), "json=true"]) == code
    return json.loads(capsys.readouterr().out)


def refusal(capsys, *tokens):
    """What stands on standard error where the command is wrong."""
    assert main(["check", *map(str, tokens)]) == 2
    return capsys.readouterr().err


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return write_ball(tmp_path_factory.mktemp("good") / "ball").folder


def test_a_good_capture_is_called_good(good, capsys, tmp_path):
    sheet = tmp_path / "sheet.png"
    found = check(capsys, good, f"out={sheet}")
    assert (found["verdict"], found["findings"], found["format"]) == ("good", [], "colmap")
    assert (found["views_train"], found["views_eval"], found["points"]) == (21, 3, 1500)
    assert found["image_sizes"] == ["64x48 (24)"]
    assert (found["images_decoded"], found["images"]) == (24, 24)
    assert (found["gaussians"], found["gaussians_mb"]) == (1500, 1.4)
    assert found["next"] == f"gsfw train method=3dgs data={good}"
    assert found["next_minutes"] == 5.0
    assert found["next_steps"] is None
    assert found["sheet"] == str(sheet)
    assert sheet.read_bytes().startswith(b"\x89PNG")


def test_in_a_read_only_folder_the_report_is_whole_and_the_sheet_is_elsewhere(
    good, capsys, monkeypatch, tmp_path, read_only_folder
):
    monkeypatch.chdir(read_only_folder)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["check", f"data={good}", "images=5"]) == 0
    said = capsys.readouterr()
    (sheet,) = tmp_path.glob("gsfw-*/check.png")
    assert "verdict: good: no fault was found\n" in said.out
    assert f"cameras, points and images: {sheet}" in said.out
    assert re.fullmatch(
        rf"warning: check.png cannot be written: .*\. It is {sheet} instead; out=FILE gives it "
        r"another place\.\n",
        said.err,
    )


def test_a_sheet_that_cannot_be_written_anywhere_costs_nothing_else(
    good, capsys, monkeypatch, tmp_path
):
    (tmp_path / "file").touch()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    found = check(capsys, good, "images=5", f"out={tmp_path}/file/sheet.png")
    assert (found["verdict"], found["sheet"]) == ("good", "")
    assert "out=FILE gives it another place" in found["sheet_problem"]


def test_people_get_a_table_sentences_and_the_next_command(good, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(["check", f"data={good}", "images=5"]) == 0
    out = capsys.readouterr().out
    assert "21 to train on, 3 held out, from 24 places" in out
    assert "5 of 24 images were decoded, evenly spread" in out
    assert re.search(r"\nfield of view +[\d.]+ degrees across the width *\n", out)
    assert "verdict: good: no fault was found\n" in out
    assert "cameras, points and images: check.png" in out
    assert out.endswith("It trains for 5 minutes. Add --dry-run to see the plan first.\n")
    assert (tmp_path / "check.png").is_file()


@pytest.mark.slow
def test_view_dependence_is_told_where_tracks_are(capsys, tmp_path):
    folder = track_ball(tmp_path / "a").folder
    document = check(capsys, folder, "out=none")
    found = document["view_dependence"]
    assert document["tracked_points"] == found["points"] > 100
    assert found["matte"] > 0.8
    assert main(["check", str(folder), "out=none"]) == 0
    out = capsys.readouterr().out
    assert f"of {found['points']} points are matte" in out
    assert found["advice"] in out


def test_without_tracks_view_dependence_is_not_measured(good, capsys):
    document = check(capsys, good, "out=none")
    assert (document["tracked_points"], document["view_dependence"]) == (0, None)
    assert main(["check", str(good), "out=none"]) == 0
    assert (
        "not measured: no points are known to be in 8 of these images or more; it takes 50"
        in capsys.readouterr().out
    )


def test_settings_of_training_are_taken_and_kept_in_the_suggestion(good, capsys):
    keys = ("method=3dgs", "downscale=2", "datamanager.mask_mode=empty", "holdout_every=0")
    found = check(capsys, good, *keys, "out=none")
    assert found["image_sizes"] == ["32x24 (24)"]
    assert [finding["kind"] for finding in found["findings"]] == ["nothing held out"]
    assert found["verdict"] == "good"  # A note takes nothing away.
    assert found["next"].startswith(f"gsfw train method=3dgs data={good}")
    assert "downscale=2" in found["next"]
    assert "datamanager.mask_mode=empty" in found["next"]
    assert found["sheet"] == ""


def test_a_size_of_images_is_suggested_for_runs_of_steps_alone(good, capsys, monkeypatch):
    monkeypatch.setattr("gsfw.preparation.check.plan.LONG_SIDE", 32)
    assert "downscale=" not in check(capsys, good, "out=none")["next"], "a plan chooses it"
    assert "downscale=2" in check(capsys, good, "steps=100", "out=none")["next"]


@pytest.mark.slow
def test_the_suggestion_is_a_command_that_fits(good, capsys, tmp_path):
    command = check(capsys, good, "out=none")["next"].split()
    assert main([*command[1:], "--dry-run"]) == 0
    capsys.readouterr()
    moving = write_moving(tmp_path / "a", np.linspace(0, 1, 6).tolist(), 4)
    found = check(capsys, moving, "holdout_every=0", "out=none")
    assert (found["times"], found["cameras_at_each_time"]) == (6, 4)
    assert found["methods"][0] == "spacetime"
    assert "dynamic3dgs" in found["methods"]
    assert "random_region=object" in found["next"]
    assert main([*found["next"].split()[1:], "random_points=500", "--dry-run"]) == 0


def both(capsys, data, *words):
    """Whether check and a dry run say that a method trains on a data set, and what they print."""
    capsys.readouterr()
    checked = main(["check", *words, str(data), "out=none"])
    dry = main(["train", *words, f"data={data}", "--dry-run"])
    said = capsys.readouterr()
    return checked, dry, said.out + said.err


@pytest.mark.slow
@pytest.mark.parametrize("method", ["3dgs", "4dgs"])
def test_check_and_a_dry_run_refuse_the_same_method(good, capsys, method):
    checked, dry, said = both(capsys, good, f"method={method}", "downscale=2", "device=cpu")
    assert (checked == 0, dry == 0) == (method == "3dgs", method == "3dgs")
    assert said.count("is for captures of several times") == (0 if method == "3dgs" else 2)


def test_one_camera_at_each_time_is_refused_by_both_for_tracking(tmp_path, capsys):
    moving = write_moving(tmp_path / "a", np.linspace(0, 1, 12).tolist(), 1)
    checked, dry, said = both(capsys, moving, "method=dynamic3dgs", "holdout_every=0")
    assert (checked, dry) == (1, 2)
    assert said.count("follows what several cameras see at each time, and 'a' has 12 training") == 2
    assert "everything fits" not in said


@pytest.mark.slow
def test_a_dry_run_does_not_say_that_everything_fits_where_check_says_that_nothing_trains(
    tmp_path, capsys
):
    folder = write_ball(tmp_path / "a", ball(count=3)).folder
    checked, dry, said = both(capsys, folder, "method=3dgs", "device=cpu")
    assert (checked, dry) == (1, 1)
    assert said.count("Will not train - few views: 2 images to train on.\n") == 2
    assert "this data set will not train: see gsfw check" in said
    assert "everything fits" not in said


def test_findings_are_told_before_images_are_decoded(tmp_path, capsys, monkeypatch):
    folder = write_ball(tmp_path / "a", ball(count=12)).folder
    told = []

    def looked(*arguments):
        told.append(capsys.readouterr().out)
        return original(*arguments)

    from gsfw.preparation.check import image_sample

    original = image_sample.ImageSample.of
    monkeypatch.setattr(image_sample.ImageSample, "of", staticmethod(looked))
    assert main(["check", str(folder), "out=none"]) == 0
    assert "Limit - few views" in told[0]
    assert "verdict" not in told[0]
    assert capsys.readouterr().out.splitlines()[-3].startswith("verdict: usable with limits")


def test_limits_still_exit_with_zero_and_have_advice(capsys, tmp_path):
    folder = write_ball(tmp_path / "a", ball(count=12)).folder
    found = check(capsys, folder, "out=none")
    assert found["verdict"] == "usable with limits"
    finding = found["findings"][0]
    assert finding["kind"] == "few views"
    assert all(finding[part] for part in ("found", "why", "advice"))


def test_a_capture_that_will_not_train_exits_with_one(capsys, tmp_path):
    folder = write_ball(tmp_path / "a", ball(count=3)).folder
    found = check(capsys, folder, "out=none", code=1)
    assert found["verdict"] == "will not train"
    assert found["findings"][0]["weight"] == "stop"
    assert main(["check", str(folder), "out=none"]) == 1
    out = capsys.readouterr().out
    assert "Will not train - few views: 2 images to train on.\n" in out
    assert "verdict: will not train (few views" in out
    assert "next:" not in out


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("images/view_001.png", b"", "the file is empty (0 bytes)"),
        ("images/view_001.png", b"not a picture", "these 13 bytes are no PNG"),
        ("sparse/0/points3D.bin", b"\x01", "is cut off or damaged"),
    ],
)
def test_a_capture_that_cannot_be_opened_gets_its_reason(capsys, tmp_path, name, content, reason):
    folder = write_ball(tmp_path / "a").folder
    (folder / name).write_bytes(content)
    found = check(capsys, folder, code=1)
    (finding,) = found["findings"]
    assert (found["verdict"], finding["kind"]) == ("will not train", "cannot be read")
    assert reason in finding["found"]
    assert finding["advice"]


def test_the_built_in_scene_is_checked(capsys):
    found = check(capsys, "datamanager=synthetic", "downscale=4", "images=6", "out=none")
    assert found["verdict"] != "will not train"
    assert found["next"].startswith("gsfw train method=3dgs datamanager=synthetic")


def test_mistakes_are_explained(good, capsys, tmp_path):
    assert refusal(capsys) == (
        "error: gsfw check: the data set is missing.\nWrite gsfw check PATH; see --help.\n"
    )
    assert "both" in refusal(capsys, good, f"data={good}")
    assert "there is no such file or folder" in refusal(capsys, tmp_path / "nothing")
    assert refusal(capsys, good, "images=some") == (
        "error: images=some: expected a number of at least 1, or all.\n"
    )
    assert "unknown key 'downscal'" in refusal(capsys, good, "downscal=2")


def test_help_says_what_else_is_taken(capsys):
    assert main(["check", "--help"]) == 0
    out = capsys.readouterr().out
    assert "usage: gsfw check DATA [key=value ...]" in out
    assert "keys below it takes those of gsfw train" in out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "verdict", "kinds", "changes"),
    [
        ("captures/fox", "good", {"exposure drifts", "open side"}, ""),
        ("captures/plush", "good", {"open side"}, ""),
        ("synthetic/chair", "good", {"no points"}, ""),
        (
            "dynamic/garden_robot_mv",
            "usable with limits",
            {"few views", "open side", "no points"},
            " background=white random_region=object",
        ),
        (
            "dynamic/mujoco_collision",
            "usable with limits",
            {"few views", "no points", "one camera at each time"},
            "",
        ),
    ],
)
def test_real_captures_get_what_they_deserve(shared_data, capsys, name, verdict, kinds, changes):
    path = shared_data / name
    found = check(capsys, path, "out=none")
    assert found["verdict"] == verdict
    assert {finding["kind"] for finding in found["findings"]} == kinds
    assert found["next"].endswith(f"data={path}{changes}")


@pytest.mark.slow
def test_fox_is_partly_matte_and_its_exposure_drifts(shared_data, capsys):
    found = check(capsys, shared_data / "captures" / "fox", "out=none")["view_dependence"]
    assert found["points"] > 2500
    assert 0.55 < found["matte"] < 0.75
    assert 0.25 < found["degree_1"] < 0.45
    assert found["degree_2"] < 0.1
    assert found["by_chance"] < 0.03
    assert 1 < sum(found["gain_db"]) < 4
    assert found["deviation_without_exposure"] < 0.6 * found["deviation"]
    assert found["deviation_if_misplaced"] < found["deviation_without_exposure"]
    assert "sh=adaptive" in found["advice"]


@pytest.mark.slow
def test_a_damaged_real_model_gets_its_reason(shared_data, capsys):
    found = check(capsys, shared_data / "malformed" / "colmap_truncated", code=1)
    assert "is cut off or damaged" in found["findings"][0]["found"]
