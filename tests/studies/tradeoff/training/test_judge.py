"""Drawing goes in rounds, and ends with the time."""

import sys
from types import SimpleNamespace

import fake_variants
import pytest

from gsfw.core.callback import Control
from gsfw.plugins.registry import installed
from gsfw.studies.planned_run import plan_runs
from gsfw.studies.result_store import ResultStore
from gsfw.studies.runner import Runner, RunnerSettings
from gsfw.studies.study import Cell
from gsfw.studies.tradeoff.training.judge import DRAW_MS, DRAW_SPREAD, RunJudge


@pytest.mark.parametrize(("over", "rounds"), [(False, 3), (True, 1)])
def test_there_are_as_many_rounds_as_there_is_time_for(tmp_path, monkeypatch, over, rounds):
    command = (sys.executable, "-S", fake_variants.__file__)
    monkeypatch.setattr("gsfw.studies.run_process.COMMAND", command)
    cell = Cell("baseline", "10 steps", {"method": "3dgs", "steps": 10, "seed": 1})
    plan = plan_runs([cell], installed(), tmp_path, tmp_path)
    store = ResultStore(tmp_path / "results.json", "")
    list(Runner(plan, store, RunnerSettings(), Control()).run())
    times = iter([3.0, 5.0, 4.0])
    turn = SimpleNamespace(take=lambda device: next(times))
    restored = SimpleNamespace(composition=SimpleNamespace(parts=SimpleNamespace(device=None)))
    monkeypatch.setattr(RunJudge, "_turn", lambda self, result: (turn, restored))
    drawn = list(RunJudge(installed(), 1.0).time(plan, store, 3, lambda: over))
    assert drawn == list(range(1, rounds + 1))
    figures = store.results[cell.key].figures
    assert figures[DRAW_MS] == (3.0 if over else 4.0)
    assert figures[DRAW_SPREAD] == (0.0 if over else 1.0)
