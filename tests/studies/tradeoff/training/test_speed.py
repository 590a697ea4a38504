"""Speeds are measured in a part of the time that is left; the runs are those of fake_variants."""

import sys
import time

import pytest
from support import fake_variants

from gsfw.core.callback import Control
from gsfw.core.errors import DataError
from gsfw.jobs.local import LocalExecutor
from gsfw.plugins.registry import installed
from gsfw.studies.result import ResultStore
from gsfw.studies.tradeoff.training.trainer import Stopped, Workshop, measure_speeds

GIVEN = {"method": "3dgs"}
SIZES = [{**GIVEN, "downscale": factor} for factor in (1.0, 2.0)]


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    command = (sys.executable, "-S", fake_variants.__file__)
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", command)


def workshop(folder, seconds=600.0, control=None):
    store = ResultStore(folder / "results.json", "")
    deadline = time.monotonic() + seconds
    return Workshop(
        installed(), folder, store, control or Control(), LocalExecutor(2), deadline=deadline
    )


def test_every_size_is_measured_and_known_the_next_time(tmp_path):
    speeds = measure_speeds(SIZES, workshop(tmp_path), 100)
    assert [speed.downscale for speed in speeds] == [1.0, 2.0]
    assert [speed.step_seconds for speed in speeds] == [0.01, 0.01]
    made = (tmp_path / "runs" / "made.txt").read_text()
    assert measure_speeds(SIZES, workshop(tmp_path), 100) == speeds
    assert (tmp_path / "runs" / "made.txt").read_text() == made


def test_without_time_nothing_is_measured(tmp_path):
    assert measure_speeds(SIZES, workshop(tmp_path, seconds=10.0), 100) == []
    assert not (tmp_path / "runs").exists()


def test_a_run_that_fails_says_why(tmp_path):
    killed = [{**SIZES[0], "seed": fake_variants.KILLED}]
    with pytest.raises(DataError, match="SIGKILL"):
        measure_speeds(killed, workshop(tmp_path), 100)


def test_a_stop_leaves_it(tmp_path):
    control = Control()
    control.request_stop("enough")
    with pytest.raises(Stopped):
        measure_speeds(SIZES[:1], workshop(tmp_path, control=control), 100)
