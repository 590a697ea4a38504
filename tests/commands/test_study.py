"""Tests of gsfw.commands.study; what runners and reports do is tested with them."""

import json
import shutil
from pathlib import Path

import pytest
from support.fake_training import INTERRUPTS, REFUSED
from support.small_scene import SMALL_SCENE
from support.small_study import quick  # noqa: F401 - a fixture
from support.states import assert_same_bits

from gsfw.commands.main import main
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.registry import installed
from gsfw.studies.planned_run import plan_runs
from gsfw.studies.study_file import read_study

STUDY = """
title: A small study
settings: {steps: 10, datamanager.moving: true}
seeds: [1]
rows:
  still: {method: 3dgs, ignore_time: true}
  moves: {method: 4dgs}
scenes: {balls: {}}
columns: [psnr, num_gaussians]
"""


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(STUDY)
    return path


@pytest.fixture
def out(tmp_path) -> str:
    return f"out={tmp_path / 'out'}"


def study(*arguments: object) -> int:
    return main(["study", *map(str, arguments)])


@pytest.mark.usefixtures("quick")
def test_runs_are_made_once_and_the_table_is_shown(file, out, tmp_path, capsys):
    assert study(file, out) == 0
    said = capsys.readouterr().out
    assert said.startswith("A small study: 0 runs finished, 2 left, about 18 s\n")
    assert "[1/2] still on balls, seed 1: PSNR 20.01, " in said
    assert said.endswith(
        "\n"
        "balls\n"
        "       PSNR (dB)  Gaussians\n"
        "still  20.01      1,000\n"
        "moves  25.01 *    1,000\n"
        "\n"
        f"written: {tmp_path}/out/study.md, study.csv, study.png, results.json\n"
    )
    assert sorted(path.name for path in (tmp_path / "out").iterdir() if path.name[0] != ".") == [
        "results.json", "runs", "study.csv", "study.md", "study.png",
    ]  # fmt: skip
    assert study(file, out) == 0
    assert capsys.readouterr().out.startswith("A small study: 2 runs finished, 0 left\n\nballs\n")


@pytest.mark.usefixtures("quick")
def test_tables_are_made_again_from_results_alone(file, out, tmp_path, monkeypatch):
    assert study(file, out) == 0
    report = (tmp_path / "out" / "study.md").read_text()
    for name in ("runs", "study.md", "study.csv", "study.png"):
        path = tmp_path / "out" / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", ("no such program",))
    assert study(file, out, "table=true") == 0
    assert (tmp_path / "out" / "study.md").read_text() == report
    assert f"command: `gsfw study {file} {out}`" in report


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_programs_get_one_document(file, out, tmp_path, capsys):
    file.write_text(STUDY.replace("[1]", f"[1, {REFUSED}]"))
    assert study(file, out, "json=true") == 1
    document = json.loads(capsys.readouterr().out)
    (table,) = document.pop("tables")
    assert document == {
        "results": str(tmp_path / "out" / "results.json"),
        "made": 2,
        "kept": 0,
        "failed": [f"still on balls, seed {REFUSED}", f"moves on balls, seed {REFUSED}"],
        "left": [],
        "missing": [],
    }
    assert table["rows"][1]["figures"]["psnr"]["mean"] == 25.01
    assert table["rows"][1]["note"] == f"seed {REFUSED} failed: this seed is refused."


@pytest.mark.usefixtures("quick")
def test_an_interrupted_study_says_how_to_go_on(file, out, capsys):
    file.write_text(STUDY.replace("[1]", f"[{INTERRUPTS}, 1]"))
    assert study(file, out) == 130
    said = capsys.readouterr().out
    assert "stopped; it continues another time, from its checkpoint if it has one\n" in said
    assert "4 runs left: interrupted by Ctrl-C. The same command continues.\n" in said
    assert study(file, out, "only=still") == 0


@pytest.mark.usefixtures("quick")
def test_a_budget_leaves_the_rest_for_another_time(file, out, capsys):
    assert study(file, out, "budget.minutes=1e-9") == 0
    said = capsys.readouterr().out
    assert "2 runs left: budget.minutes=1e-09 is used up. The same command continues." in said


@pytest.mark.usefixtures("quick")
def test_dry_lists_what_would_be_done(file, out, tmp_path, capsys):
    assert study(file, out, "dry=true") == 0
    said = capsys.readouterr().out
    assert "balls  still  1     10     9 s    is trained\n" in said
    assert "about 18 s in all (a guess: nothing is measured yet)" in said
    assert not (tmp_path / "out").exists()
    study(file, out, "only=still")
    file.write_text(STUDY.replace("steps: 10", "steps: 12"))
    capsys.readouterr()
    assert study(file, out, "dry=true") == 0
    assert "is trained again: steps=12 (was 10)" in capsys.readouterr().out
    file.write_text(STUDY)
    assert study(file, out, "dry=true", "json=true") == 0
    document = json.loads(capsys.readouterr().out)
    assert [item["what"] for item in document["runs"]] == ["is there", "is trained"]


@pytest.mark.usefixtures("quick")
def test_scenes_without_their_data_are_left_out_and_said(file, out, tmp_path, capsys):
    file.write_text(STUDY.replace("{balls: {}}", "{balls: {}, robot: {data: robot}}"))
    assert study(file, out, f"root={tmp_path}") == 0
    assert capsys.readouterr().err == (
        f"warning: scene robot is left out: {tmp_path}/robot is not there; "
        "root=DIR says where it is\n"
    )
    assert study(file, out, f"root={tmp_path}", "only=robot") == 2
    assert capsys.readouterr().err.endswith(
        f"error: {file}: the data of none of its scenes is in {tmp_path}.\n"
        "Give the folder that the paths in the file begin at with root=DIR.\n"
    )


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["jobs=-1"], "error: jobs=-1: expected a number of at least 0.\n"),
        (["budget.minutes=0"], "error: budget.minutes=0: expected more than 0.\n"),
        (["budget.minute=3"], "unknown key 'budget.minute'. Did you mean 'budget.minutes'?\n"),
        (["table=true", "dry=true"], "error: table=true runs nothing, so dry and again have"),
        (["only=x"], "error: only=x: 'A small study' has no such row or scene.\n"),
        (["table=true"], "results.json: there are no results of"),
    ],
)
def test_a_wrong_option_is_told(file, out, capsys, arguments, expected):
    assert study(file, out, *arguments) == 2
    assert expected in capsys.readouterr().err


def test_a_place_that_cannot_be_written_is_told_before_anything_runs(file, tmp_path, capsys):
    (tmp_path / "taken").touch()
    assert study(file, f"out={tmp_path / 'taken'}") == 2
    assert "taken cannot be written: File exists.\n" in capsys.readouterr().err


def test_without_a_file_it_says_so(capsys):
    assert study() == 2
    assert (
        capsys.readouterr().err == "error: gsfw study: FILE is missing.\nSee gsfw study --help.\n"
    )


REAL = """
settings: {%s, steps: 20, checkpoint_every: 10}
rows:
  first: {method: 3dgs}
  unfit: {method: 4dgs}
scenes: {small: {}}
"""


@pytest.mark.slow
def test_real_runs_are_made_fail_and_go_on_to_the_same_bits(
    finished_run, tmp_path, capsys, monkeypatch
):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # As here, which bits depend on.
    settings = [item.replace("=", ": ") for item in SMALL_SCENE]
    file, out = tmp_path / "real.yaml", tmp_path / "out"
    file.write_text(REAL % ", ".join(settings))
    found = read_study(file)
    first, _ = plan_runs(found.cells(), installed(), Path(), out)
    # What a run leaves that was killed after its step 10.
    assert main(["train", *first.arguments()]) == 0
    first.folder.summary.unlink()
    first.folder.checkpoint(20).unlink()

    assert study(file, f"out={out}") == 1
    said = capsys.readouterr().out
    assert "first on small, seed 42: PSNR " in said
    assert "unfit on small, seed 42: failed: " in said
    results = json.loads((out / "results.json").read_text())
    (result,) = results["results"]
    (failure,) = results["failures"]
    assert "Traceback" not in failure["error"]
    assert result["figures"]["megabytes"] > 0
    assert result["origin"]["threads"] >= 1
    whole = RunFolder(finished_run)
    assert result["figures"]["psnr"] == json.loads(whole.summary.read_text())["psnr"]
    ours, theirs = (
        read_checkpoint(folder.checkpoint(20))["model"] for folder in (first.folder, whole)
    )
    assert_same_bits(ours, theirs)


@pytest.mark.usefixtures("quick")
def test_a_column_that_no_result_has_is_told(file, out, capsys):
    file.write_text(STUDY.replace("[psnr, num_gaussians]", "[psnrr]"))
    assert study(file, out) == 0
    told = "columns: no result has a figure 'psnrr'. Did you mean 'psnr'?\n"
    assert told in capsys.readouterr().err
    assert study(file, out, "table=true") == 0
    assert told in capsys.readouterr().err


@pytest.mark.usefixtures("quick")
def test_an_interrupted_repetition_does_not_promise_to_go_on(file, out, capsys):
    assert study(file, out, "again=true", "budget.minutes=1e-9") == 0
    said = capsys.readouterr().out
    assert (
        "is used up. The same command trains all of them again; only=ROW,SCENE names those" in said
    )


@pytest.mark.usefixtures("quick")
def test_a_failed_run_says_why_and_what_to_do(file, out, tmp_path, capsys):
    file.write_text(STUDY.replace("[1]", f"[{REFUSED}]"))
    assert study(file, out, "only=still") == 1
    said = capsys.readouterr().out
    failed = f"still on balls, seed {REFUSED}: failed: this seed is refused.\nTake another.\n"
    assert failed in said
    assert f"\nballs\nstill: seed {REFUSED} failed: this seed is refused.\n" in said
    assert "## balls\n\n- still: seed" in (tmp_path / "out" / "study.md").read_text()
