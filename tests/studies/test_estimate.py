"""Estimates follow measured runs, jobs share the threads, and origins name the machine."""

import os
from dataclasses import replace

import pytest
from support.small_study import plan, small_study

from gsfw.core.cores import cores
from gsfw.jobs.local import threads_per_job
from gsfw.planning.asked import BOUND
from gsfw.studies import origin as origin_module
from gsfw.studies.origin import origin
from gsfw.studies.result import Result
from gsfw.studies.runner import START_SECONDS, STEP_SECONDS, Estimate


def took(row: str, scene: str, step_seconds: float) -> Result:
    figures = {"steps": 100, "train_seconds": 100 * step_seconds}
    return Result(row, scene, 1, "0", {}, {}, figures)


def test_a_run_takes_as_long_as_what_is_most_like_it(tmp_path):
    run = plan(small_study(), tmp_path)[0]
    known: list[Result] = []
    assert Estimate(known).seconds(run) == START_SECONDS + 10 * STEP_SECONDS
    assert not Estimate(known).is_measured
    for row, scene, step_seconds in (
        ("other", "other", 1.0),
        ("still", "other", 2.0),
        ("other", "balls", 3.0),
        ("still", "balls", 4.0),
    ):
        known.append(took(row, scene, step_seconds))
        expected = START_SECONDS + 10 * step_seconds
        assert Estimate(known).seconds(run) == pytest.approx(expected)


def timed(row: str, wall: float, **settings: object) -> Result:
    """A finished run that was planned, with the steps of its schedule."""
    figures = {"steps": 4000, "train_seconds": 50.0, "wall_seconds": wall}
    return Result(row, "balls", 1, "0", {}, settings, figures)


def test_a_planned_run_takes_its_time_whatever_its_steps_took_elsewhere(tmp_path):
    run = plan(small_study(), tmp_path)[0]
    minutes = replace(run, settings={**run.settings, "minutes": 2.0})
    known = [took("still", "balls", 4.0)]
    assert Estimate(known).seconds(minutes) == 120.0
    until = replace(run, settings={**run.settings, "until": "31"})
    assert Estimate(known).seconds(until) == 60 * BOUND
    known.append(timed("still", 400.0, until="31"))
    assert Estimate(known).seconds(until) == 400.0, "it ended at its quality"


def test_steps_of_a_planned_run_say_nothing_of_other_runs(tmp_path):
    run = plan(small_study(), tmp_path)[0]
    known = [timed("planned", 118.0, minutes=2.0)]
    assert Estimate(known).seconds(run) == START_SECONDS + 10 * STEP_SECONDS


def test_what_starts_took_is_taken_from_those_that_were_measured(tmp_path):
    run = plan(small_study(), tmp_path)[0]
    result = took("still", "balls", 1.0)
    timed = Result("still", "balls", 2, "0", {}, {}, {**result.figures, "wall_seconds": 130.0})
    assert Estimate([result, timed]).seconds(run) == pytest.approx(30 + 10 * 1.0)


def test_what_is_done_is_not_counted(tmp_path):
    run = plan(small_study(), tmp_path)[0]
    run.folder.checkpoints.mkdir(parents=True)
    run.folder.checkpoint(4).touch()
    run.folder.config.touch()
    assert Estimate([]).seconds(run) == pytest.approx(START_SECONDS + 6 * STEP_SECONDS)


def test_jobs_share_the_threads_that_there_are(monkeypatch):
    assert threads_per_job(1) is None
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    assert [threads_per_job(jobs) for jobs in (2, 3, 9)] == [4, 2, 1]
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert threads_per_job(2) == max(1, cores() // 2)


def test_the_origin_names_machine_and_versions(monkeypatch, tmp_path):
    found = origin()
    assert found["cores"] == cores() <= (os.cpu_count() or 1)
    assert found["cpu"]
    monkeypatch.setattr(origin_module, "SOURCE", tmp_path)
    assert origin()["commit"] is None, "an installed package has none"
