"""Recordings that fail, graphs that are given up, and kinds of steps beyond their number."""

import logging
from types import SimpleNamespace

import pytest
import torch
from support.recorded_run import Run

from gsfw.core.loop import step_graphs
from gsfw.core.loop.step_inputs import StepInputs
from gsfw.kernels.cuda.errors import CudaError
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod

KEY = StaticGaussiansMethod.graph_key

STATIC = {"strategy": "none", "sh_degree_interval": "1"}

# Whole runs; shapes are checked by the tests of the parts.
pytestmark = [pytest.mark.unchecked, pytest.mark.usefixtures("unknown_to_the_host")]


class Released:
    """Notes what a recorder is told to give back."""

    def __init__(self, run: Run, monkeypatch) -> None:
        self.told: list[bool] = []
        monkeypatch.setattr(
            run.recorder, "release", lambda at_once=False: self.told.append(at_once)
        )


def kinds(run: Run) -> list[bool]:
    """The kinds of steps that are known: true for each that has a graph."""
    return [kind.graph is not None for kind in run.trainer.updates._graphs._kinds.values()]


def full(*arguments):
    raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 1.00 GiB.")


def failing(work, times: int, failure=full):
    """The same function, which fails so many times first."""
    left = iter(range(times))

    def attempt(*arguments):
        if next(left, None) is not None:
            failure()
        return work(*arguments)

    return attempt


def unlaunched(record):
    """Record as usual, but recordings that cannot be launched."""

    def attempt(work):
        record(work)
        return SimpleNamespace(replay=full)

    return attempt


def refused():
    raise CudaError("the kernel is used for the first time while a CUDA graph is captured", "")


@pytest.mark.slow
@pytest.mark.parametrize("failure", [full, refused])
def test_a_run_goes_on_without_graphs_and_their_memory(tmp_path, monkeypatch, caplog, failure):
    run, usual = Run(tmp_path / "a", True, **STATIC), Run(tmp_path / "b", False, **STATIC)
    released = Released(run, monkeypatch)
    monkeypatch.setattr(run.recorder, "record", failing(run.recorder.record, 9, failure))
    with caplog.at_level(logging.WARNING):
        assert run.steps(6) == usual.steps(6)
    assert len(caplog.records) == 1
    assert kinds(run) == []
    assert run.trainer.updates._graphs._recorder is None
    assert released.told[-1]
    assert run.trainer.updates.idle_memory == 0


@pytest.mark.parametrize("place", ["record", "inputs"])
def test_a_recording_that_finds_memory_full_has_that_of_other_graphs(tmp_path, monkeypatch, place):
    run, usual = Run(tmp_path / "a", True, **STATIC), Run(tmp_path / "b", False, **STATIC)
    monkeypatch.setattr(
        StaticGaussiansMethod, "graph_key", lambda self, step: (KEY(self, step), step >= 6)
    )
    expected, found = usual.steps(6), run.steps(6)
    assert kinds(run).count(True) == 1
    released = Released(run, monkeypatch)
    part, name = (run.recorder, "record") if place == "record" else (StepInputs, "copied")
    monkeypatch.setattr(part, name, failing(getattr(part, name), 1))
    expected, found = expected + usual.steps(6), found + run.steps(6)
    assert found == expected
    assert released.told == [True]
    assert kinds(run) == [False, True]
    assert run.recorder.recorded == 2


def test_a_step_that_finds_memory_full_has_that_of_the_graphs(tmp_path, monkeypatch):
    run, usual = Run(tmp_path / "a", True, **STATIC), Run(tmp_path / "b", False, **STATIC)
    expected, found = usual.steps(6), run.steps(6)
    released = Released(run, monkeypatch)
    monkeypatch.setattr(run.parts.method, "graph_key", lambda step: None)
    monkeypatch.setattr(run.rasterizer, "_render", failing(run.rasterizer._render, 1))
    assert found + run.steps(2) == expected + usual.steps(2)
    assert released.told == [True]
    monkeypatch.setattr(run.rasterizer, "_render", full)
    with pytest.raises(torch.OutOfMemoryError):
        run.steps(1)


def test_a_recording_whose_launch_finds_memory_full_is_the_last(tmp_path, monkeypatch, caplog):
    run, usual = Run(tmp_path / "a", True, **STATIC), Run(tmp_path / "b", False, **STATIC)
    released = Released(run, monkeypatch)
    monkeypatch.setattr(run.recorder, "record", unlaunched(run.recorder.record))
    with caplog.at_level(logging.WARNING):
        assert run.steps(6) == usual.steps(6)
    assert len(caplog.records) == 1
    assert released.told[-1]
    assert run.recorder.recorded == 1


def test_memory_of_earlier_graphs_is_given_back_where_there_is_none_now(tmp_path, monkeypatch):
    run = Run(tmp_path, True, **STATIC)
    run.steps(1)
    released = Released(run, monkeypatch)
    monkeypatch.setattr(type(run.recorder), "idle_memory", 5)
    monkeypatch.setattr(run.rasterizer, "_render", failing(run.rasterizer._render, 1))
    run.steps(1)
    assert released.told[-1]


def test_graphs_of_other_rows_are_forgotten_at_once(tmp_path, monkeypatch):
    run = Run(tmp_path, True, **STATIC)
    run.steps(4)
    assert kinds(run) == [True]
    run.parts.table.keep(torch.arange(40))
    monkeypatch.setattr(run.parts.method, "graph_key", lambda step: None)
    run.steps(1)
    assert kinds(run) == []


def test_an_ended_run_holds_no_graphs(tmp_path):
    run = Run(tmp_path, True, **STATIC)
    run.steps(4)
    run.trainer.updates.give_up()
    assert not any(kinds(run))


def alternating(monkeypatch, count: int) -> None:
    """Let steps be of so many kinds in turn."""
    monkeypatch.setattr(
        StaticGaussiansMethod,
        "graph_key",
        lambda self, step: (KEY(self, step), count, step % count),
    )


@pytest.mark.slow
def test_kinds_beyond_their_number_are_run_as_usual_and_told_once(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(step_graphs, "MOST_GRAPHS", 2)
    run, usual = Run(tmp_path / "a", True, **STATIC), Run(tmp_path / "b", False, **STATIC)
    monkeypatch.setattr(step_graphs, "UNUSED_STEPS", 100)
    alternating(monkeypatch, 2)
    run.steps(8)
    assert kinds(run) == [True, True]
    alternating(monkeypatch, 4)
    with caplog.at_level(logging.INFO):
        run.steps(8)
    usual.steps(16)
    for name, values in usual.columns().items():
        assert torch.equal(run.columns()[name], values), name
    assert kinds(run) == [True, True]
    assert sum("kinds" in record.getMessage() for record in caplog.records) == 1


def test_kinds_that_do_not_come_again_make_place_for_others(tmp_path, monkeypatch):
    monkeypatch.setattr(step_graphs, "MOST_GRAPHS", 2)
    run = Run(tmp_path, True, **STATIC)
    monkeypatch.setattr(step_graphs, "UNUSED_STEPS", 3)
    alternating(monkeypatch, 10**6)  # No step is like another one.
    run.steps(6)
    assert kinds(run) == [False, False]
    alternating(monkeypatch, 2)
    run.steps(8)
    assert kinds(run) == [True, True]


def test_of_more_kinds_in_turn_the_first_ones_are_recorded(tmp_path, monkeypatch):
    monkeypatch.setattr(step_graphs, "MOST_GRAPHS", 2)
    run = Run(tmp_path, True, **STATIC)
    alternating(monkeypatch, 3)
    run.steps(9)
    assert kinds(run) == [True, True]


def test_graphs_that_are_not_used_any_more_make_place_for_others(tmp_path, monkeypatch):
    monkeypatch.setattr(step_graphs, "MOST_GRAPHS", 2)
    monkeypatch.setattr(step_graphs, "UNUSED_STEPS", 3)
    run = Run(tmp_path, True, **STATIC)
    alternating(monkeypatch, 2)
    run.steps(8)
    assert kinds(run) == [True, True]
    recorded = run.recorder.recorded
    alternating(monkeypatch, 1)
    run.steps(6)
    assert True in kinds(run)
    assert run.recorder.recorded == recorded + 1
