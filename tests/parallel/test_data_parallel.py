"""Data parallelism: views of a step are divided among processes, and no bit of the model changes.

Threads stand for processes here; tests/parallel/test_processes.py has real ones.
"""

from dataclasses import replace
from functools import cache
from itertools import count

import pytest
import torch
from support.memory_training import Recorder, trainer, with_parts
from support.sampling import sampled
from support.states import assert_same_bits, without_clock
from support.thread_group import in_threads

from gsfw.core.errors import ConfigError, LostProcessError, TrainingError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.distractors import Distractors
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.refinement.budget import BudgetSize, with_budget
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.refiner import Refiner
from gsfw.parallel.data_parallel import DataParallel, _in_parts
from gsfw.samplers.uniform import UniformSampler
from gsfw.strategies.adc import AdcConfig

# Whole trainings; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

STEPS = 30


def trained(folder, size: int, strategy: str = "adc", steps: int = STEPS, **options):
    """The state and the summary of the first of ``size`` processes."""

    def run(group):
        own = trainer(folder / f"{size}-{group.rank}", strategy, Recorder(), steps=steps, **options)
        own = with_parts(own, team=DataParallel(group))
        summary = own.fit()
        return without_clock(own.state_dict()), summary

    results = in_threads(size, run)
    for state, _ in results[1:]:
        assert_same_bits(state, results[0][0])
    return results[0]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Gives the state that one process trains with a strategy on four views of a step."""

    @cache
    def state(strategy: str):
        return trained(tmp_path_factory.mktemp("alone"), 1, strategy, views_per_step=4)[0]

    return state


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "strategy"),
    sampled([(2, "adc"), (2, "mcmc"), (3, "adc"), (3, "mcmc")], [0]),
)
def test_any_number_of_processes_trains_the_same_bits(tmp_path, alone, size, strategy):
    # Four views of a step: with three processes, two of them have none in the second round.
    several, _ = trained(tmp_path, size, strategy, views_per_step=4)
    assert_same_bits(alone(strategy), several)


@pytest.mark.slow
def test_processes_without_a_view_train_too(tmp_path):
    one, _ = trained(tmp_path, 1, views_per_step=1)
    several, _ = trained(tmp_path, 2, views_per_step=1)
    assert_same_bits(one, several)


@pytest.mark.slow
def test_images_of_several_sizes_are_views_of_one_step(tmp_path):
    sizes = ((32, 24), (24, 32))
    one, _ = trained(tmp_path, 1, views_per_step=4, sizes=sizes)
    several, _ = trained(tmp_path, 2, views_per_step=4, sizes=sizes)
    assert_same_bits(one, several)


def test_the_first_step_is_that_of_a_batch_up_to_rounding(tmp_path):
    """A batch divides the sum of its losses, and views add up their shares."""
    split, _ = trained(tmp_path, 2, "none", steps=1, views_per_step=4)
    batched = trainer(tmp_path / "batched", "none", Recorder(), steps=1, views_per_step=4)
    batched.fit()
    for name, values in batched.state_dict()["optimizer"]["moments"].items():
        torch.testing.assert_close(
            split["optimizer"]["moments"][name][0]["first"], values[0]["first"], msg=name
        )


class Failing(UniformSampler):
    """A sampler that fails after 12 steps, as a plugin of one process may."""

    def next(self):
        if self.calls == 12:
            raise IndexError("a bug")
        self.calls += 1
        return super().next()

    calls = 0


@pytest.mark.parametrize("fails", [0, 1])
def test_an_error_of_any_process_loses_no_finished_step(tmp_path, fails):
    def run(group):
        own = trainer(tmp_path, "none", Recorder(), checkpoint_every=8)
        own = with_parts(own, team=DataParallel(group))
        if group.rank == fails:
            own = with_parts(own, sampler=Failing(6, 1, 3))
        with pytest.raises(IndexError if group.rank == fails else LostProcessError):
            own.fit()
        group._table.leave()  # As its process ends, the others lose it.
        return own.step, dict(own.parts.model.state_dict())

    (step, model), _ = in_threads(2, run)
    kept = read_checkpoint(RunFolder(tmp_path).latest_checkpoint())
    assert kept["step"] == step > 8
    assert_same_bits(kept["model"], model)


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_gradients_of_any_types_and_sizes_are_cut_into_equal_parts(size):
    tensors = [torch.zeros(2, 3), torch.zeros(()), torch.zeros(4, dtype=torch.float64)]
    for start, tensor in zip((1, 0, 10), tensors, strict=True):
        tensor.grad = torch.arange(start, start + tensor.numel()).view_as(tensor).to(tensor)
    tensors[1].grad = None  # As 0.
    parts = [torch.cat(part) for part in _in_parts(tensors, size)]
    assert {len(part) for part in parts} == {-(-11 // size)}
    whole = torch.cat(parts)
    assert whole.dtype == torch.float64
    assert whole[:11].tolist() == [1, 2, 3, 4, 5, 6, 0, 10, 11, 12, 13]


@pytest.mark.slow
def test_the_bytes_are_those_of_the_formula(tmp_path):
    views, size = 4, 2
    state, summary = trained(tmp_path, size, "none", views_per_step=views)
    moments = [m["first"] for group in state["optimizer"]["moments"].values() for m in group]
    parameters = sum(tensor.numel() for tensor in moments)
    expected = 4 * parameters * (size - 1) / size * (views // size + 1)
    # Statistics of rows, losses and the agreement before each step come on top.
    rows = len(moments[0])
    others = 2 * 4 * rows * views // size + 1000
    per_step = summary["bytes_sent"] / STEPS
    assert expected <= per_step <= expected + others
    assert summary["processes"] == size


@pytest.mark.slow
def test_a_run_goes_on_with_another_number_of_processes(tmp_path, alone):
    trained(tmp_path / "parts", 2, views_per_step=4, checkpoint_every=10)
    state = read_checkpoint(RunFolder(tmp_path / "parts" / "2-0").checkpoint(20))

    def go_on(group):
        run = trainer(
            tmp_path / f"on-{group.rank}", "adc", Recorder(), steps=STEPS, views_per_step=4
        )
        run = with_parts(run, team=DataParallel(group))
        run.load_state_dict(state)
        run.fit()
        return without_clock(run.state_dict())

    assert_same_bits(in_threads(3, go_on)[0], alone("adc"))


@pytest.mark.slow
def test_refiners_that_read_images_get_those_of_other_processes(tmp_path):
    config = AdcConfig(refine_start=5, refine_stop=50, refine_every=10, budget="60")

    def run(group):
        own = trainer(
            tmp_path / f"{group.size}-{group.rank}",
            "adc",
            Recorder(),
            steps=STEPS,
            views_per_step=2,
        )
        refiners = Refiners(with_budget(config, own.parts.data.scene))
        own = with_parts(own, team=DataParallel(group), refiners=refiners)
        own.fit()
        return without_clock(own.state_dict())

    assert BudgetSize.parse(config).is_given
    assert_same_bits(in_threads(1, run)[0], in_threads(2, run)[0])


@pytest.mark.slow
def test_any_number_of_processes_leaves_out_the_same_distractors(tmp_path):
    def run(group):
        folder = tmp_path / f"{group.size}-{group.rank}"
        own = trainer(folder, "adc", Recorder(), steps=12, views_per_step=2)
        own = with_parts(own, team=DataParallel(group), distractors=Distractors(start=1))
        own.fit()
        return without_clock(own.state_dict())

    assert_same_bits(in_threads(1, run)[0], in_threads(2, run)[0])


def test_a_request_to_stop_in_one_process_stops_all_after_the_same_step(tmp_path):
    def run(group):
        stop = Recorder(stop_at=7 if group.rank == 1 else None)
        own = trainer(tmp_path / str(group.rank), "none", stop, views_per_step=2)
        own = with_parts(own, team=DataParallel(group))
        own.fit()
        return own.step

    assert in_threads(2, run) == [7, 7]


def test_only_the_first_process_writes_and_evaluates(tmp_path):
    watchers = [Recorder(), Recorder()]

    def run(group):
        own = trainer(
            tmp_path / str(group.rank), "none", watchers[group.rank], steps=10, views_per_step=2
        )
        return with_parts(own, team=DataParallel(group)).fit()

    first, second = in_threads(2, run)
    assert "psnr" in first
    assert second == {"completed": True}
    assert not (tmp_path / "1").exists()
    assert watchers[0].reports
    assert not watchers[1].reports
    assert watchers[0].reports[-1].losses["l1"] > 0


class Watching(Refiner):
    name = "watching"

    def before_backward(self, context, model) -> None:
        """Would attach hooks."""

    def refine(self, context):
        return {}


class Partial(Refiner):
    """Prunes rows by something that only one process has."""

    name = "partial"
    reads_images = False
    numbers = count()

    def __init__(self) -> None:
        self.number = next(self.numbers)

    def refine(self, context):
        if context.step == 3:
            context.table.keep(torch.arange(50 + self.number % 2))
        return {}


def test_refiners_that_watch_single_views_are_refused_by_name(tmp_path):
    run = trainer(tmp_path, "none", Recorder())
    parts = replace(run.parts, refiners=Refiners([Watching()]))
    with pytest.raises(ConfigError, match=r"Watching \(watching\) watches the backward pass"):
        in_threads(1, lambda group: DataParallel(group).check(parts))


def test_refiners_that_decide_differently_are_found_before_the_next_step(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.parallel.environment.LINGER", 0.1)

    def run(group):
        own = trainer(tmp_path / str(group.rank), "none", Recorder(), views_per_step=2)
        own = with_parts(own, team=DataParallel(group), refiners=Refiners([Partial()]))
        with pytest.raises((TrainingError, SystemExit)) as raised:
            own.fit()
        return raised.value

    first, second = in_threads(2, run)
    assert isinstance(second, SystemExit)  # The first one has the message.
    assert "the processes disagree on the rows of the model (5" in str(first)


class Curious(Refiner):
    """Reads splats, which only the process that renders a view has."""

    name = "curious"

    def observe(self, context, statistics, model) -> None:
        context.splats.means.sum()

    def refine(self, context):
        return {}


def test_refiners_that_read_splats_of_other_processes_are_told_so(tmp_path):
    def run(group):
        own = trainer(tmp_path / str(group.rank), "none", Recorder(), views_per_step=2)
        own = with_parts(own, team=DataParallel(group), refiners=Refiners([Curious()]))
        with pytest.raises(ConfigError, match="has read 'means' of a view that another process"):
            own.fit()

    in_threads(2, run)
