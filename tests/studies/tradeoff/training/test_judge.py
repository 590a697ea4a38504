"""Drawing goes in rounds, FLIP run by run, and both end with the time."""

import sys
from dataclasses import replace
from statistics import mean
from types import SimpleNamespace

import pytest
from support import fake_variants
from support.tradeoff_models import finished_model

from gsfw.core.callback import Control
from gsfw.core.datamanager import Split
from gsfw.jobs.local import LocalExecutor
from gsfw.plugins.registry import installed
from gsfw.studies.planned_run import plan_runs
from gsfw.studies.result import ResultStore
from gsfw.studies.runner import Runner, RunnerSettings
from gsfw.studies.study import Cell
from gsfw.studies.tradeoff.flip import flip
from gsfw.studies.tradeoff.training.judge import DRAW_MS, DRAW_SPREAD, FLIP, RunJudge


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A run that took no time, and the store of its result."""
    command = (sys.executable, "-S", fake_variants.__file__)
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", command)
    cell = Cell("baseline", "10 steps", {"method": "3dgs", "steps": 10, "seed": 1})
    plan = plan_runs([cell], installed(), tmp_path, tmp_path)
    store = ResultStore(tmp_path / "results.json", "")
    list(Runner(plan, store, RunnerSettings(), Control(), LocalExecutor()).run())
    return plan, store


@pytest.mark.parametrize(("over", "rounds"), [(False, 3), (True, 1)])
def test_there_are_as_many_rounds_as_there_is_time_for(made, monkeypatch, over, rounds):
    plan, store = made
    times = iter([3.0, 5.0, 4.0])
    turn = SimpleNamespace(take=lambda device: next(times))
    restored = SimpleNamespace(composition=SimpleNamespace(parts=SimpleNamespace(device=None)))
    monkeypatch.setattr(RunJudge, "_turn", lambda self, result: (turn, restored))
    drawn = list(RunJudge(installed(), 1.0).time(plan, store, 3, lambda: over))
    assert drawn == list(range(1, rounds + 1))
    figures = store.results[plan[0].cell.key].figures
    assert figures[DRAW_MS] == (3.0 if over else 4.0)
    assert figures[DRAW_SPREAD] == (0.0 if over else 1.0)


@pytest.mark.slow
def test_flip_is_that_of_the_held_out_views_in_the_judged_size(made, finished_run):
    pytest.importorskip("flip_evaluator")
    (run,), store = made
    known = replace(store.results[run.cell.key], run=str(finished_run))
    store.keep(known)
    found = {}
    for downscale in (1.0, 2.0):
        judge = RunJudge(installed(), downscale)
        assert list(judge.compare([run], store, lambda: False)) == [1]
        found[downscale] = store.results[run.cell.key].figures[FLIP]
    assert store.results[run.cell.key].figures == {**known.figures, FLIP: found[2.0]}
    model = finished_model(finished_run)
    each = []
    for place, camera in enumerate(model.cameras):
        (batch,) = model.parts.data.load(Split.EVAL, [place], model.device)
        photo = batch.target(model.subject.settings.background)[0]
        each.append(flip(model.subject.image(model.subject.splats(), camera), photo, None))
    assert found[1.0] == pytest.approx(mean(each))
    assert found[2.0] != pytest.approx(mean(each))


def test_flip_is_left_for_another_time_where_there_is_none(made):
    plan, store = made
    before = dict(store.results)
    assert list(RunJudge(installed(), 1.0).compare(plan, store, lambda: True)) == []
    assert store.results == before
