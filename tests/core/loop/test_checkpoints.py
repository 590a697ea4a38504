"""States that no checkpoint can hold, found in mid-run: the model and the last checkpoint stay."""

import pytest
import torch
from support.memory_training import Recorder, trainer, with_parts
from support.states import assert_same_bits

from gsfw.core.errors import ConfigError, DataError, TrainingError
from gsfw.core.loop.checkpoint_file import MODEL_ALONE, read_checkpoint
from gsfw.core.loop.trainer import Trainer
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.refiner import Refiner
from gsfw.samplers.uniform import UniformSampler

pytestmark = pytest.mark.unchecked


class Counting(UniformSampler):
    """A sampler whose state is another one from a step on."""

    def __init__(self, begin: int, value: object) -> None:
        super().__init__(6, 1, 3)
        self.begin, self.value, self.asked = begin, value, 0

    def next(self):
        self.asked += 1
        return super().next()

    def state_dict(self):
        if self.asked < self.begin:
            return super().state_dict()
        if isinstance(self.value, Exception):
            raise self.value
        return {**super().state_dict(), "cache": self.value}


def run_of(folder, begin: int, value: object, **plan) -> Trainer:
    run = trainer(folder, "none", Recorder(), **plan)
    return with_parts(run, sampler=Counting(begin, value))


def refusal(run: Trainer) -> TrainingError:
    with pytest.raises(TrainingError) as caught:
        run.fit()
    return caught.value


def test_a_state_that_no_checkpoint_can_hold_is_found_long_before_the_next_one(tmp_path):
    run = run_of(tmp_path, 20, lambda view: view, checkpoint_every=8, steps=5000)
    error = refusal(run)
    assert 20 <= run.step <= 22
    source = f"Counting of {__name__.partition('.')[0]}"
    model = tmp_path / "checkpoints" / f"model_{run.step:09d}.pt"
    assert error.message == (
        f"no checkpoint can be written after {run.step} steps: {source}: state_dict has an object "
        "of the class function as ['cache'], which no checkpoint can hold."
    )
    assert error.advice.splitlines()[1:] == [
        f"{model} has the model after {run.step} steps: gsfw view {model}",
        f"{run.folder.checkpoint(16)} is kept: once that is corrected, gsfw resume {tmp_path} "
        "continues from there.",
    ]
    kept = read_checkpoint(model)
    assert kept["step"] == run.step
    assert kept[MODEL_ALONE]
    assert_same_bits(kept["model"], dict(run.parts.model.state_dict()))


def test_a_run_goes_on_from_the_checkpoint_before_and_removes_the_model(tmp_path):
    refusal(run_of(tmp_path, 7, object(), checkpoint_every=4, steps=12))
    again = trainer(tmp_path, "none", Recorder(), checkpoint_every=4, steps=12)
    again.load_state_dict(read_checkpoint(again.folder.latest_checkpoint()))
    assert again.step == 4
    assert again.fit()["completed"]
    assert not list(again.folder.checkpoints.glob("model_*"))


def test_the_states_of_refiners_are_looked_at_too(tmp_path):
    class Cached(Refiner):
        name = "cached"

        def refine(self, context):
            self.cache = torch.nn.Linear(1, 1)
            return {}

        def state_dict(self):
            return vars(self)

    run = trainer(tmp_path, "none", Recorder(), steps=50)
    error = refusal(with_parts(run, refiners=Refiners([Cached()])))
    assert error.message.startswith("no checkpoint can be written after 1 steps: Cached of ")
    assert "object of the class torch.nn.modules.linear.Linear as ['cache']" in error.message


@pytest.mark.parametrize("log_every", [1, 100])
def test_a_tensor_that_is_not_finite_is_named_at_the_next_checkpoint(tmp_path, log_every):
    value = torch.tensor(torch.inf)
    run = run_of(tmp_path, 3, value, checkpoint_every=5, steps=100, log_every=log_every)
    error = refusal(run)
    assert error.message == (
        "no checkpoint can be written after 5 steps: sampler.cache is not finite."
    )
    assert (tmp_path / "checkpoints" / "model_000000005.pt").is_file()
    assert run.folder.latest_checkpoint() == run.folder.checkpoint(0)


def test_a_bug_of_a_state_stays_a_bug_and_the_model_is_kept(tmp_path, caplog):
    with pytest.raises(KeyError):
        run_of(tmp_path, 3, KeyError("cache")).fit()
    model = tmp_path / "checkpoints" / "model_000000003.pt"
    assert model.is_file()
    assert caplog.messages == [f"{model} has the model after 3 steps"]


def test_a_state_that_is_not_finite_at_the_start_is_no_bug_of_gsfw(tmp_path):
    run = run_of(tmp_path, 0, torch.tensor([float("nan")]))
    with pytest.raises(ConfigError, match="is not finite"):
        run.fit()


class Failing(Counting):
    """A sampler that fails after so many views."""

    def next(self):
        if self.asked == self.begin:
            raise self.value
        return super().next()

    def state_dict(self):
        return UniformSampler.state_dict(self)


@pytest.mark.parametrize("error", [IndexError("a bug"), DataError("a photo is gone", "")])
def test_an_error_in_a_later_step_loses_no_finished_step(tmp_path, caplog, error):
    run = trainer(tmp_path, "none", Recorder(), checkpoint_every=8, steps=30)
    run = with_parts(run, sampler=Failing(12, error))
    with pytest.raises(type(error)) as caught:
        run.fit()
    assert caught.value is error
    kept = run.folder.latest_checkpoint()
    assert kept == run.folder.checkpoint(run.step)
    assert run.step > 8
    assert f"{kept} has the state after {run.step} steps: once the error below" in caplog.text
    again = trainer(tmp_path, "none", Recorder(), checkpoint_every=8, steps=30)
    again.load_state_dict(read_checkpoint(kept))
    assert_same_bits(dict(again.parts.model.state_dict()), dict(run.parts.model.state_dict()))
    assert again.fit()["completed"]


def test_an_error_within_a_change_of_rows_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    run = trainer(tmp_path, "none", Recorder(), checkpoint_every=8, steps=30)
    refine = Refiners.refine

    def failing(refiners, step, *rest):
        if step == 12:
            raise IndexError("a bug")
        return refine(refiners, step, *rest)

    monkeypatch.setattr(Refiners, "refine", failing)
    with pytest.raises(IndexError, match="a bug"):
        run.fit()
    assert run.folder.latest_checkpoint() == run.folder.checkpoint(8)


def test_before_the_first_update_the_part_itself_is_blamed_and_nothing_is_written(tmp_path):
    with pytest.raises(ConfigError, match="as \\['cache'\\], which no checkpoint can hold"):
        run_of(tmp_path, 0, object()).fit()
    assert not list(tmp_path.rglob("*.pt"))


def test_a_model_that_cannot_be_written_either_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    run = run_of(tmp_path, 7, object(), checkpoint_every=4, steps=12)
    monkeypatch.setattr(type(run.folder), "write_model", unwritable)
    assert refusal(run).advice.splitlines()[1].startswith(f"{run.folder.checkpoint(4)} is kept")


def unwritable(self, step, state):
    raise ConfigError("it has no form that can be written.")
