"""Errors of processes that share the Gaussians: no finished step is lost while all of them run.

Threads stand for processes here; test_processes.py has real ones.
"""

import itertools
from collections import Counter

import pytest
import torch
from support.memory_training import Recorder, trainer, with_parts
from support.states import assert_same_bits
from support.thread_group import in_threads

from gsfw.core.errors import LostProcessError, OutputError, SilentProcessError
from gsfw.core.loop.checkpoint_file import MODEL_ALONE, read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.refinement.refiners import Refiners
from gsfw.parallel.sharded.team import GaussianParallel
from gsfw.samplers.uniform import UniformSampler

pytestmark = pytest.mark.unchecked

FAILS_AT = 12
SHARDS = 4


class Failing(UniformSampler):
    """A sampler that fails after some views, or whose state does."""

    def __init__(self, of_views: BaseException | None = None, of_state: object = None) -> None:
        super().__init__(6, 1, 3)
        self.of_views, self.of_state, self.drawn = of_views, of_state, 0

    def next(self):
        if self.drawn == FAILS_AT and self.of_views is not None:
            raise self.of_views
        self.drawn += 1
        return super().next()

    def state_dict(self):
        if self.drawn < FAILS_AT or self.of_state is None:
            return super().state_dict()
        if isinstance(self.of_state, BaseException):
            raise self.of_state
        return {**super().state_dict(), "cache": self.of_state}


def shared(run, group):
    """The trainer of a process with its share of the rows."""
    team = GaussianParallel(group, SHARDS)
    parts = team.share(run.parts)
    return with_parts(run, team=team, table=parts.table, edited=parts.edited)


def three_runs(folder, change):
    """The trainers of three processes after their errors.

    Args:
        folder: of the run.
        change: returns a trainer with other parts, or ``None``.
    """

    def run(group):
        own = shared(trainer(folder, "none", Recorder(), checkpoint_every=8, steps=30), group)
        own = change(own) or own
        with pytest.raises((Exception, SystemExit)) as caught:
            own.fit()
        while (lost := group.spare()) is not None:  # The connections of a process end with it.
            group = lost
        return own, caught.value

    return in_threads(3, run)


def rows_of(found):
    return torch.cat([run.parts.model.columns()["means"].values.detach() for run, _ in found])


def failing(rank, **parts):
    """Changes the sampler of one process; of all if ``rank`` is ``None``."""

    def change(run):
        is_it = rank is None or run.parts.team.rank == rank
        return with_parts(run, sampler=Failing(**parts)) if is_it else None

    return change


@pytest.mark.slow
@pytest.mark.parametrize("fails", [0, 2])
def test_an_error_of_any_process_loses_no_finished_step(tmp_path, caplog, fails):
    found = three_runs(tmp_path / "run", failing(fails, of_views=IndexError("a bug")))
    for run, error in found:
        is_it = run.parts.team.rank == fails
        assert type(error) is (IndexError if is_it else LostProcessError)
        assert run.step == FAILS_AT
    kept = read_checkpoint(RunFolder(tmp_path / "run").checkpoint(FAILS_AT))
    assert torch.equal(kept["model"]["means.values"], rows_of(found))
    assert caplog.text.count("has the state after 12 steps") == 1
    assert caplog.text.count("once the error below") == (fails == 0)

    whole = trainer(tmp_path / "whole", "none", Recorder(), checkpoint_every=FAILS_AT, steps=16)
    in_threads(1, lambda group: shared(whole, group).fit())
    expected = read_checkpoint(whole.folder.checkpoint(FAILS_AT))
    # The first of the other processes has drawn the views of the next step.
    others = dict.fromkeys(("train_seconds", "walk", "sampler", "generator")[: 4 if fails else 2])
    assert_same_bits({**kept, **others}, {**expected, **others})


@pytest.mark.slow
def test_a_step_that_is_half_done_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    refine = Refiners.refine

    def failing_once(refiners, step, *rest):
        if step == FAILS_AT and next(calls) == 0:
            raise IndexError("a bug")
        return refine(refiners, step, *rest)

    calls = itertools.count()
    monkeypatch.setattr(Refiners, "refine", failing_once)
    three_runs(tmp_path, lambda run: None)
    assert RunFolder(tmp_path).latest_checkpoint() == RunFolder(tmp_path).checkpoint(8)


@pytest.mark.slow
def test_a_killed_process_takes_its_rows_along_and_the_first_one_says_so(tmp_path, caplog):
    found = three_runs(tmp_path, failing(1, of_views=SystemExit(9)))
    assert [type(error) for _, error in found] == [LostProcessError, SystemExit, LostProcessError]
    kept = RunFolder(tmp_path).checkpoint(8)
    assert RunFolder(tmp_path).latest_checkpoint() == kept
    said = f"the steps after {kept} are lost with the Gaussians of another process"
    assert caplog.messages == [said]


def test_a_process_that_is_killed_in_the_check_of_states_is_no_fault_of_a_state(tmp_path, caplog):
    found = three_runs(tmp_path, failing(1, of_state=SystemExit(9)))
    assert [type(error) for _, error in found] == [LostProcessError, SystemExit, LostProcessError]
    assert all(str(error) == "another thread has ended." for _, error in (found[0], found[2]))
    assert caplog.text.count("are lost with the Gaussians of another process") == 1


def test_a_silent_process_in_the_check_of_states_stays_one(tmp_path, monkeypatch):
    asked, gathered = Counter(), GaussianParallel.gathered

    def silent_at_the_check(team, value):
        asked[team.rank] += value == ""  # The states of the first checkpoint and of the check.
        if asked[team.rank] == 2:
            raise SilentProcessError("silent")
        return gathered(team, value)

    monkeypatch.setattr(GaussianParallel, "gathered", silent_at_the_check)
    found = three_runs(tmp_path, failing(None))
    assert [type(error) for _, error in found] == [SilentProcessError] * 3


@pytest.mark.parametrize("error", [SilentProcessError("silent"), OutputError("the disk is full")])
def test_errors_that_would_come_again_and_long_waits_end_at_once(tmp_path, error):
    three_runs(tmp_path, failing(0, of_views=error))
    assert RunFolder(tmp_path).latest_checkpoint() == RunFolder(tmp_path).checkpoint(8)


class Unreadable(RunFolder):
    """A folder that a process may not read."""

    def latest_checkpoint(self):
        raise PermissionError(self.path)


def test_processes_that_cannot_read_the_folder_give_their_rows_to_the_first_one(tmp_path):
    def change(run):
        if run.parts.team.leads:
            return with_parts(run, sampler=Failing(of_views=IndexError("a bug")))
        run.folder = Unreadable(run.folder.path)
        return None

    three_runs(tmp_path, change)
    assert RunFolder(tmp_path).latest_checkpoint() == RunFolder(tmp_path).checkpoint(FAILS_AT)


@pytest.mark.parametrize("fails", [0, 1, None])
def test_a_state_that_no_checkpoint_can_hold_leaves_the_model_with_all_rows(tmp_path, fails):
    found = three_runs(tmp_path, failing(fails, of_state=object()))
    (first, error), *others = found
    assert "no checkpoint can be written after" in str(error)
    assert "object of the class object as ['cache']" in str(error)
    assert "\n\n" not in str(error)
    assert str(error).endswith(f"gsfw resume {tmp_path} continues from there.")
    assert all(type(other) is LostProcessError for _, other in others)
    (model,) = first.folder.models_alone()
    kept = read_checkpoint(model)
    assert kept[MODEL_ALONE]
    assert kept["step"] == first.step
    assert torch.equal(kept["model"]["means.values"], rows_of(found))


@pytest.mark.slow
def test_a_state_that_is_not_finite_leaves_the_model_with_all_rows(tmp_path):
    found = three_runs(tmp_path, failing(None, of_state=torch.tensor(torch.nan)))
    assert "after 16 steps: sampler.cache is not finite." in str(found[0][1])
    (model,) = found[0][0].folder.models_alone()
    assert torch.equal(read_checkpoint(model)["model"]["means.values"], rows_of(found))
