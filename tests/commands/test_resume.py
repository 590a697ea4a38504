"""Tests of gsfw.commands.resume; that it is exact is tested end to end."""

import json
import shutil

import pytest
from support.resuming import resumed_to_the_same_bits

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy of a finished run of 20 steps that may be changed."""
    return shutil.copytree(finished_run, tmp_path / "run")


def refusal(capsys, *arguments: str) -> str:
    assert main(["resume", *arguments]) == 2
    return capsys.readouterr().err


def test_a_finished_run_says_so(run, capsys):
    assert main(["resume", str(run)]) == 0
    assert capsys.readouterr().out == (
        f"{run} is finished: it has done all of its 20 steps. "
        f"To train longer: gsfw resume {run} steps=N\n"
    )
    assert main(["resume", str(run), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == {"run": str(run), "completed": True, "steps": 20}


def test_more_steps_go_on_where_it_ended_and_are_remembered(run, capsys):
    assert main(["resume", str(run), "steps=24"]) == 0
    assert "continuing after step 20" in capsys.readouterr().out
    assert json.loads(RunFolder(run).summary.read_text())["steps"] == 24
    assert main(["resume", str(run)]) == 0
    assert "it has done all of its 24 steps" in capsys.readouterr().out


def test_a_run_that_cannot_be_written_to_goes_on_in_a_copy(run, capsys):
    (run / ".lock").unlink()
    (run / ".lock").mkdir()
    said = refusal(capsys, str(run), "steps=24")
    assert "cannot be written: " in said
    assert said.endswith("Choose a copy of the run in a folder that you may write to.\n")


def test_a_run_that_lost_its_final_evaluation_gets_it(run, capsys):
    before = json.loads(RunFolder(run).summary.read_text())
    RunFolder(run).summary.unlink()
    assert main(["resume", str(run)]) == 0
    assert json.loads(RunFolder(run).summary.read_text())["psnr"] == before["psnr"]


def test_a_run_that_was_killed_while_it_wrote_its_results_writes_them(run, capsys):
    folder = RunFolder(run)
    splats, log = folder.splats.read_bytes(), folder.metrics_log.read_text()
    folder.splats.unlink()
    folder.report.unlink()
    folder.unfinished.touch()  # Until all is written.
    assert main(["resume", str(run)]) == 0
    assert folder.splats.read_bytes() == splats
    assert folder.report.is_file()
    assert len(folder.metrics_log.read_text().splitlines()) == len(log.splitlines())
    assert not folder.unfinished.exists()


def test_fewer_steps_than_done_are_refused(run, capsys):
    assert refusal(capsys, str(run), "steps=10") == (
        "error: steps=10: the run has done 20 steps already.\n"
        "Give a larger number, or an earlier checkpoint.\n"
    )


def test_settings_that_are_part_of_the_state_cannot_change(run, capsys):
    said = refusal(capsys, str(run), "strategy=none")
    assert said.startswith("error: strategy cannot change when a run is resumed.\nKeys that may: ")
    assert "Did you mean 'steps'?" in refusal(capsys, str(run), "step=30")


def test_without_a_run_or_with_two_it_says_so(capsys):
    assert refusal(capsys) == ("error: gsfw resume: RUN is missing.\nSee gsfw resume --help.\n")
    assert "more than one RUN is given" in refusal(capsys, "a", "b")


def test_another_machine_is_a_warning(run, capsys, monkeypatch):
    monkeypatch.setattr(
        "gsfw.plugins.restore.environment",
        lambda device, backend: {"threads": 1000, "device": "cpu"},
    )
    assert main(["resume", str(run), "steps=21"]) == 0
    assert "and is 1000: the result may differ in its last bits" in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_whose_pictures_grow_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.core.loop.resolution.MIN_STEPS", 1)
    whole = RunFolder(tmp_path / "whole")
    settings = (
        "datamanager.views=4", "datamanager.eval_views=1", "datamanager.points=150",
        "steps=20", "checkpoint_every=10", "log_every=1",
        "resolution_schedule=auto", "resolution_steps=16",
    )  # fmt: skip
    assert main(["train", "method=3dgs", *settings, f"out={whole.path}"]) == 0
    lines = [json.loads(line) for line in whole.metrics_log.read_text().splitlines()]
    small = [line["step"] for line in lines if line.get("resolution", 1) < 1]
    assert small == list(range(1, len(small) + 1))
    assert 10 < len(small) < 20, "pictures must grow after the checkpoint"
    resumed_to_the_same_bits(whole.path)


def test_help_says_what_may_change(capsys):
    assert main(["resume", "--help"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("usage: gsfw resume RUN [key=value ...]\n")
    assert "Keys that may change: steps, data, device" in said
