"""Tests of gsfw.studies.runner, mostly with a stand-in for training."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from support.fake_training import (
    DISK_FULL,
    HUNG_UP,
    INTERRUPTS,
    KILLED,
    REFUSED,
    TORN,
    WAITS_FOR_ANOTHER,
)
from support.small_study import TINY, make, plan, small_study

from gsfw.core.callback import Control
from gsfw.jobs.local import LocalExecutor
from gsfw.studies.planned_run import fingerprint
from gsfw.studies.report import RESULTS
from gsfw.studies.result import ResultStore
from gsfw.studies.runner import Runner, RunnerSettings

pytestmark = pytest.mark.usefixtures("quick")


def kept(folder: Path) -> ResultStore:
    return ResultStore(folder / RESULTS, "")


def dates(folder: Path) -> dict[str, int]:
    """When each run was made."""
    return {str(path): path.stat().st_mtime_ns for path in folder.glob("runs/**/metrics.json")}


def test_runs_are_made_and_kept(tmp_path):
    ended = make(small_study(), tmp_path)
    assert [(item.number, item.total) for item in ended] == [(1, 2), (2, 2)]
    result = kept(tmp_path).results["balls", "moves", 1]
    assert result.figures["psnr"] == 25.01
    assert result.figures["peak_memory_mb.rss"] == 400
    assert "over_time" not in result.figures
    assert result.protocol["checkpoint"] == "last"
    assert result.given == {**TINY, "method": "4dgs", "seed": 1}
    assert result.settings["strategy"] == "adc"
    assert set(result.origin) >= {"gsfw", "commit", "torch", "cpu", "cores"}
    assert ended[-1].seconds_left == 0


def test_finished_runs_are_not_repeated(tmp_path):
    make(small_study(), tmp_path)
    before = dates(tmp_path)
    assert make(small_study(), tmp_path) == []
    (tmp_path / RESULTS).unlink()
    assert make(small_study(), tmp_path) == [], "they are found in their folders"
    assert len(kept(tmp_path).results) == 2
    assert dates(tmp_path) == before


def test_a_run_that_a_signal_has_left_without_some_of_its_files_goes_on(tmp_path):
    make(small_study(), tmp_path)
    left = next(tmp_path.glob("runs/**/metrics.json")).with_name(".unfinished")
    left.touch()
    (ended,) = make(small_study(), tmp_path)
    assert ended.number == 1


def test_results_alone_are_enough(tmp_path):
    make(small_study(), tmp_path / "a")
    results = tmp_path / "b" / RESULTS
    results.parent.mkdir()
    results.write_bytes((tmp_path / "a" / RESULTS).read_bytes())
    assert make(small_study(), tmp_path / "b") == []


def test_only_what_has_other_settings_is_made_again(tmp_path):
    make(small_study(), tmp_path)
    rows = {**small_study().rows, "moves": {"method": "4dgs", "steps": 12}}
    (ended,) = make(small_study(rows=rows), tmp_path)
    assert ended.run.cell.row == "moves"
    assert kept(tmp_path).results["balls", "moves", 1].figures["steps"] == 12
    (back,) = plan(small_study(), tmp_path)[1:]
    assert back.is_finished(), "the earlier run is still there"
    assert make(small_study(), tmp_path) == []
    assert kept(tmp_path).results["balls", "moves", 1].figures["steps"] == 10


def test_settings_that_mean_the_same_make_nothing_again(tmp_path):
    make(small_study(), tmp_path)
    study = small_study(settings={**TINY, "antialias": False, "log_every": 3})
    assert make(study, tmp_path) == []
    assert kept(tmp_path).results["balls", "still", 1].given["antialias"] is False


@pytest.mark.slow
def test_again_makes_finished_runs_again(tmp_path):
    make(small_study(), tmp_path)
    before = dates(tmp_path)
    assert len(make(small_study(), tmp_path, again=True)) == 2
    assert dates(tmp_path).keys() == before.keys()
    assert not set(dates(tmp_path).values()) & set(before.values())


@pytest.mark.slow
def test_a_failed_run_is_recorded_and_the_others_go_on(tmp_path):
    study = small_study(seeds=(REFUSED, 1, DISK_FULL))
    ended = make(study, tmp_path)
    assert [item.failure is None for item in ended] == [False, True, False] * 2
    store = kept(tmp_path)
    refused = store.failures["balls", "still", REFUSED]
    assert (refused.error, refused.advice) == ("this seed is refused.", "Take another.")
    assert not refused.resumable
    assert store.failures["balls", "still", DISK_FULL].error == "no space is left"
    assert list(store.results) == [("balls", "moves", 1), ("balls", "still", 1)]


def test_a_failed_run_is_tried_again(tmp_path):
    study = small_study(seeds=(REFUSED,), rows={"still": {"method": "3dgs", "ignore_time": True}})
    make(study, tmp_path)
    (tmp_path / "runs" / "balls" / "still" / "allowed").touch()
    (ended,) = make(study, tmp_path)
    assert ended.result is not None
    assert not kept(tmp_path).failures


def test_a_run_that_was_killed_goes_on_from_its_checkpoint(tmp_path):
    study = small_study(seeds=(KILLED,), rows={"still": {"method": "3dgs", "ignore_time": True}})
    (ended,) = make(study, tmp_path)
    assert ended.failure is not None
    assert ended.failure.error == "the run was ended from outside by SIGKILL."
    assert ended.failure.advice.startswith("The system may have run out of memory")
    (ended,) = make(study, tmp_path)
    assert ended.result is not None
    folder = ended.run.folder.path
    assert (folder / "resumed").read_text() == str(folder)
    assert "wall_seconds" not in ended.result.figures, "it took longer than its last part"


def test_data_that_has_moved_is_told_to_a_run_that_goes_on(tmp_path):
    for name in ("before", "now"):
        place = tmp_path / name / "robot" / "sparse" / "0"
        place.mkdir(parents=True)
        (place / "cameras.bin").touch()
    rows = {"still": {"method": "3dgs", "data": "robot", "datamanager": "colmap"}}
    study = small_study(seeds=(KILLED,), rows=rows, settings={"steps": 10})
    from support.small_study import installed, plan_runs

    for name in ("before", "now"):
        planned = plan_runs(study.cells(), installed(), tmp_path / name, tmp_path)
        store = ResultStore(tmp_path / RESULTS, "")
        (ended,) = Runner(planned, store, RunnerSettings(), Control(), LocalExecutor()).run()
    folder = ended.run.folder.path
    assert (folder / "resumed").read_text() == f"{folder} data={tmp_path / 'now' / 'robot'}"


def test_two_jobs_are_at_work_at_the_same_time_and_share_the_threads(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    ended = make(small_study(seeds=(WAITS_FOR_ANOTHER,)), tmp_path, jobs=2)
    assert all(item.result is not None for item in ended)
    for item in ended:
        assert (item.run.folder.path / "threads").read_text() == "2"


def test_no_run_is_started_when_the_budget_is_over(tmp_path):
    runner = Runner(
        plan(small_study(), tmp_path),
        kept(tmp_path),
        RunnerSettings(minutes=1e-9),
        Control(),
        LocalExecutor(),
    )
    assert list(runner.run()) == []
    assert len(runner.pending) == 2


def test_what_has_not_ended_in_time_is_stopped_and_left(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.studies.runner.START_SECONDS", 0.0)
    monkeypatch.setattr("gsfw.studies.runner.STEP_SECONDS", 0.0)
    study = small_study(seeds=(WAITS_FOR_ANOTHER,), rows=STILL)
    settings = RunnerSettings(minutes=0.5 / 60, on_time=True)
    runner = Runner(plan(study, tmp_path), kept(tmp_path), settings, Control(), LocalExecutor())
    (ended,) = runner.run()
    assert (ended.result, ended.failure) == (None, None)
    assert list(runner.pending) == [ended.run]
    assert not kept(tmp_path).failures


def test_what_would_not_end_in_time_is_not_started_and_shorter_runs_are(tmp_path):
    rows = {"long": {**STILL["still"], "steps": 10_000}, **STILL}
    runner = Runner(
        plan(small_study(rows=rows), tmp_path),
        kept(tmp_path),
        RunnerSettings(minutes=1.0, on_time=True),
        Control(),
        LocalExecutor(),
    )
    (ended,) = runner.run()
    assert ended.run.cell.row == "still"
    assert [run.cell.row for run in runner.pending] == ["long"]


def test_a_stop_leaves_checkpoints_and_the_next_session_goes_on(tmp_path):
    study = small_study(seeds=(INTERRUPTS, 2), rows={"a": small_study().rows["still"]})
    control = Control()
    import signal

    before = signal.signal(signal.SIGINT, lambda *_: control.request_stop("Ctrl-C"))
    try:
        runner = Runner(
            plan(study, tmp_path), kept(tmp_path), RunnerSettings(), control, LocalExecutor()
        )
        (ended,) = runner.run()
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.result is None
    assert ended.failure is None
    assert len(runner.pending) == 2
    assert ended.run.steps_done() == 5
    assert not kept(tmp_path).failures
    assert all(item.result is not None for item in make(study, tmp_path))
    assert (ended.run.folder.path / "resumed").exists()


def test_checkpoints_of_finished_runs_may_go(tmp_path):
    study = small_study(seeds=(1,))
    (first, _) = plan(study, tmp_path)
    (ended, _) = make(study, tmp_path, keep_runs=False)
    assert ended.run.folder.path == first.folder.path
    assert not first.folder.checkpoints.exists()
    assert first.is_finished()


def test_a_damaged_result_is_made_again(tmp_path):
    make(small_study(), tmp_path)
    (tmp_path / RESULTS).unlink()
    plan(small_study(), tmp_path)[0].folder.summary.write_text("{")
    (ended,) = make(small_study(), tmp_path)
    assert ended.run.cell.row == "still"


def test_results_are_plain_json(tmp_path):
    make(small_study(), tmp_path)
    document = json.loads((tmp_path / RESULTS).read_text())
    assert document["schema"] == 1
    assert document["title"] == "A small study"
    assert [item["row"] for item in document["results"]] == ["moves", "still"]
    assert document["failures"] == []


STILL = {"still": {"method": "3dgs", "ignore_time": True}}


def test_damaged_settings_beside_a_checkpoint_fail_one_run_which_is_then_made_anew(tmp_path):
    (killed,) = make(small_study(seeds=(KILLED,), rows=STILL), tmp_path)
    killed.run.folder.config.write_text("a: [")
    study = small_study(seeds=(KILLED, 1), rows=STILL)
    failed, made = make(study, tmp_path)
    assert failed.failure is not None
    assert failed.failure.error.startswith(f"config file {killed.run.folder.config}: this is not")
    assert failed.failure.advice == "The same command removes its folder and trains the run again."
    assert made.result is not None
    (anew,) = make(study, tmp_path)
    assert not (anew.run.folder.path / "resumed").exists()
    assert anew.failure is not None
    assert anew.failure.error == "the run was ended from outside by SIGKILL.", "as that seed is"


def test_a_result_that_cannot_be_read_is_a_failure_and_the_others_go_on(tmp_path):
    failed, made = make(small_study(seeds=(TORN, 1), rows=STILL), tmp_path)
    assert failed.failure is not None
    assert "metrics.json cannot be read as the result of a run" in failed.failure.error
    assert failed.failure.advice.startswith("Remove ")
    assert made.result is not None
    assert list(kept(tmp_path).failures) == [("balls", "still", TORN)]


def test_a_run_that_a_signal_ended_early_goes_on(tmp_path):
    (ended,) = make(small_study(seeds=(HUNG_UP,), rows=STILL), tmp_path)
    assert ended.failure is not None
    assert ended.failure.error == "the run was ended from outside by SIGHUP."
    assert ended.failure.resumable


@pytest.mark.slow
def test_a_setting_that_is_new_in_gsfw_makes_nothing_again(tmp_path):
    make(small_study(), tmp_path)
    store = kept(tmp_path)
    for result in list(store.results.values()):
        # As an older gsfw wrote it, which had neither of the two.
        settings = dict(result.settings)
        del settings["antialias"], settings["sh_degree"]
        store.keep(replace(result, settings=settings, fingerprint=fingerprint(settings)))
    shutil.rmtree(tmp_path / "runs")
    assert make(small_study(), tmp_path) == []
    assert len(make(small_study(settings={**TINY, "sh_degree": 2}), tmp_path)) == 2


def test_a_damaged_result_that_cannot_be_removed_is_no_error(tmp_path, monkeypatch):
    make(small_study(), tmp_path)
    (tmp_path / RESULTS).unlink()
    broken = plan(small_study(), tmp_path)[0]
    broken.folder.summary.write_text("{")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(os, "unlink", refuse)
        patch.setattr(os, "rmdir", refuse)
        settings = RunnerSettings()
        runner = Runner(
            plan(small_study(), tmp_path), kept(tmp_path), settings, Control(), LocalExecutor()
        )
    assert [run.cell.row for run in runner.pending] == ["still"]
