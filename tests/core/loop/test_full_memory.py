"""Tests of gsfw.core.loop.full_memory, with memory that is said to be full at some place."""

import pytest
import torch
from support.memory_training import Recorder, trainer

from gsfw.core.errors import TrainingError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.checkpoints import Checkpoints
from gsfw.core.loop.full_memory import shortage
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.trainer import Trainer
from gsfw.core.loop.update import Update
from gsfw.core.refinement.refiners import Refiners

FAILING = 3
"""The step, counted from 0, in which memory is full."""


def full_at(monkeypatch, part: type, name: str, number: int = FAILING) -> None:
    """Let the call of a method with this number, counted from 0, find no memory."""
    method, calls = getattr(part, name), iter(range(1000))

    def fail(*arguments, **settings):
        if next(calls) == number:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 512.00 MiB.")
        return method(*arguments, **settings)

    monkeypatch.setattr(part, name, fail)


def refused(tmp_path, **plan) -> tuple[Trainer, TrainingError]:
    """A run that meets full memory, and what it says."""
    run = trainer(tmp_path, "adc", Recorder(), **plan)
    with pytest.raises(TrainingError) as caught:
        run.fit()
    assert caught.value.message.startswith(
        f"the GPU's memory is full after {run.step} steps, with "
    )
    assert caught.value.message.endswith(": 512.00 MiB were asked for.")
    assert caught.value.__suppress_context__
    return run, caught.value


@pytest.mark.slow
@pytest.mark.parametrize("part", ["_rendered", "_complete"])
def test_before_the_parameters_change_a_checkpoint_is_written(tmp_path, monkeypatch, part):
    full_at(monkeypatch, Update, part)
    run, error = refused(tmp_path)
    kept = run.folder.latest_checkpoint()
    assert kept == run.folder.checkpoint(FAILING)
    assert f"{kept} is kept: gsfw resume {tmp_path} device=cpu continues" in error.advice
    monkeypatch.undo()
    again = trainer(tmp_path, "adc", Recorder())
    again.load_state_dict(read_checkpoint(kept))
    for name, column in again.parts.model.state_dict().items():
        assert torch.equal(column, run.parts.model.state_dict()[name]), name
    assert again.fit()["completed"]


@pytest.mark.parametrize(
    ("part", "name"), [(Optimizer, "step"), (Update, "_observe"), (Refiners, "refine")]
)
def test_in_the_middle_of_a_step_the_last_checkpoint_is_kept(tmp_path, monkeypatch, part, name):
    full_at(monkeypatch, part, name)
    run, error = refused(tmp_path, checkpoint_every=2)
    kept = run.folder.latest_checkpoint()
    assert kept == run.folder.checkpoint(2)
    assert f"{kept} is kept: " in error.advice


def test_between_steps_a_checkpoint_is_written(tmp_path, monkeypatch):
    full_at(monkeypatch, Trainer, "_judged", 0)
    run, _ = refused(tmp_path, eval_every=4)
    assert run.folder.latest_checkpoint() == run.folder.checkpoint(4)


def test_where_a_checkpoint_finds_no_room_either_the_last_one_is_kept(tmp_path, monkeypatch):
    full_at(monkeypatch, Update, "_rendered")
    full_at(monkeypatch, Trainer, "state_dict", 2)
    run, error = refused(tmp_path, checkpoint_every=2)
    assert f"{run.folder.checkpoint(2)} is kept: " in error.advice


def test_nothing_is_lost_in_the_first_step(tmp_path, monkeypatch):
    full_at(monkeypatch, Update, "_rendered", 0)
    _, error = refused(tmp_path)
    assert error.advice == (
        "A run needs less with smaller images (downscale=2) or fewer Gaussians (strategy=mcmc "
        "strategy.cap_max=50)."
    )


def test_what_a_step_has_allocated_is_given_up_before_the_checkpoint(tmp_path, monkeypatch):
    full_at(monkeypatch, Update, "_complete")  # After the backward pass.
    found = []

    def look(self, trainer: Trainer) -> None:
        found.extend(trainer.parts.optimizer.gradients())

    monkeypatch.setattr(Checkpoints, "keep", look)
    refused(tmp_path)
    assert not any(gradient.count_nonzero() for gradient in found)


def test_the_numbers_of_torch_are_quoted():
    message = (
        "CUDA out of memory. Tried to allocate 20.00 MiB. GPU 0 has a total capacity of 7.79 GiB "
        "of which 11.38 MiB is free."
    )
    assert shortage(torch.OutOfMemoryError(message)) == (
        ": 20.00 MiB were asked for, and 11.38 MiB were free"
    )
    assert shortage(torch.OutOfMemoryError("CUDA out of memory.")) == ""
