"""A small study for tests, and runs of it that take no time."""

import sys
from pathlib import Path

import pytest

from gsfw.core.callback import Control
from gsfw.jobs.local import LocalExecutor
from gsfw.plugins.registry import installed
from gsfw.studies.planned_run import PlannedRun, plan_runs
from gsfw.studies.report import RESULTS
from gsfw.studies.result import ResultStore
from gsfw.studies.runner import Ended, Runner, RunnerSettings
from gsfw.studies.study import Study
from support import fake_training

TINY = {"steps": 10, "datamanager.moving": True}


def small_study(**changed) -> Study:
    """Two methods on the built-in scene."""
    rows = {"still": {"method": "3dgs", "ignore_time": True}, "moves": {"method": "4dgs"}}
    values = {"rows": rows, "scenes": {"balls": {}}, "settings": TINY, "seeds": (1,), **changed}
    return Study(name="small", title="A small study", **values)


def plan(study: Study, folder: Path) -> list[PlannedRun]:
    """All of its runs."""
    return plan_runs(study.cells(), installed(), Path(), folder)


def make(study: Study, folder: Path, jobs: int = 1, **settings) -> list[Ended]:
    """Make its runs; how each ended."""
    store = ResultStore(folder / RESULTS, study.title)
    with LocalExecutor(jobs) as executor:
        runs = plan(study, folder)
        return list(Runner(runs, store, RunnerSettings(**settings), Control(), executor).run())


@pytest.fixture
def quick(monkeypatch) -> None:
    """Runs are those of fake_training."""
    command = (sys.executable, "-S", fake_training.__file__)
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", command)
