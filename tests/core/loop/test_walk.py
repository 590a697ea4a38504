"""A run at its own pace: schedules end where they were meant to, and it repeats exactly."""

from pathlib import Path

import pytest
from support.sampling import sampled
from support.small_scene import SMALL_SCENE
from support.states import assert_same_bits, without_clock

from gsfw.core.callback import Callback
from gsfw.core.context import StepContext
from gsfw.core.datamanager import Split, Views
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.loop.walk import Walk
from gsfw.core.sampler import Sampler
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve
from gsfw.samplers.uniform import UniformSampler

# Whole trainings; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SCENE = {
    **dict(item.split("=") for item in SMALL_SCENE), "method": "3dgs", "device": "cpu",
    "steps": "60", "rescale": "false", "eval_every": "0", "checkpoint_every": "0", "log_every": "1",
    "strategy.refine_start": "5", "strategy.refine_stop": "40", "strategy.refine_every": "5",
}  # fmt: skip
STRATEGIES = {
    "adc": {"strategy.grow_gradient": "1e-5", "strategy.reset_every": "25"},
    "error": {"strategy.views": "4", "strategy.per_pixel": "0.1"},
    "mcmc": {"strategy.cap_max": "200"},
}
PACE = ["4:1.500", "9:0.500", "13:3.000", "20:2.000:all-views"]


class Told(Callback):
    """Remembers the steps of the schedule, and stops where it is told to."""

    def __init__(self, stop_at: int | None = None) -> None:
        self.stop_at, self.ticks, self.reports = stop_at, [], []

    def on_tick(self, step, control) -> None:
        self.ticks.append(step)
        if self.stop_at is not None and step >= self.stop_at:
            control.request_stop("the test says so")

    def on_step(self, report, control) -> None:
        self.reports.append(report)


def trainer(folder: Path, *callbacks: Callback, strategy: str = "adc", **values) -> Trainer:
    values = {**SCENE, "strategy": strategy, **STRATEGIES[strategy], **values}
    settings = resolve(installed(), [Layer("the test", values)])
    return compose(settings, installed()).trainer(RunFolder(folder), callbacks)


@pytest.mark.slow
def test_a_walk_reaches_the_last_step_once_and_rates_end_where_they_should(tmp_path):
    usual, walking = Told(), Told()
    trainer(tmp_path / "usual", usual).fit()
    summary = trainer(tmp_path / "walking", walking, pace=PACE).fit()
    assert usual.ticks == list(range(1, 61))
    assert walking.ticks == sorted(set(walking.ticks))
    assert walking.ticks[-1] == 60
    assert summary["steps"] == 60
    # Of 60 steps 4 at pace 1, 7 at 1.5, 2 at 0.5, 21 at 3, and 26 at 2.
    assert summary["updates"] == 4 + 5 + 4 + 7 + 13
    assert usual.reports[-1].learning_rates == pytest.approx(
        walking.reports[-1].learning_rates, rel=0.05
    )


@pytest.mark.slow
@pytest.mark.parametrize("strategy", sampled([("adc",), ("error",), ("mcmc",)], [0]))
def test_a_recorded_pace_repeats_with_the_same_bits(tmp_path, strategy):
    runs = [
        trainer(tmp_path / name, strategy=strategy, pace=PACE, held_back="1")
        for name in ("first", "second")
    ]
    for run in runs:
        run.fit()
    assert_same_bits(*(without_clock(run.state_dict()) for run in runs))


@pytest.mark.slow
@pytest.mark.parametrize(
    "stop_at", [9, *(pytest.param(step, marks=pytest.mark.slow) for step in (3, 14, 40))]
)
def test_a_run_that_goes_on_at_its_pace_has_the_bits_of_one_that_never_stopped(tmp_path, stop_at):
    whole = trainer(tmp_path / "whole", pace=PACE, held_back="1")
    whole.fit()
    cut = trainer(tmp_path / "cut", Told(stop_at), pace=PACE, held_back="1")
    assert cut.fit()["completed"] is False
    going_on = trainer(tmp_path / "cut", pace=PACE, held_back="1")
    going_on.load_state_dict(read_checkpoint(RunFolder(tmp_path / "cut").latest_checkpoint()))
    assert going_on.walk.updates == cut.walk.updates
    going_on.fit()
    assert_same_bits(without_clock(whole.state_dict()), without_clock(going_on.state_dict()))


def test_hasty_steps_add_no_rows(tmp_path):
    told = Told()
    trainer(tmp_path, told, pace=["10:4.500"]).fit()
    rows = {report.step: report.num_gaussians for report in told.reports}
    assert rows[10] > rows[5], "rows grow before"
    assert rows[60] <= rows[10]
    assert not any("reset" in report.refined for report in told.reports if report.step > 10)


def test_views_that_are_held_back_are_trained_on_in_the_last_part_alone(tmp_path):
    run = trainer(tmp_path, pace=["40:1.000:all-views"], held_back="1")
    (held,) = run.walk.held_back.views
    seen: dict[int, set[int]] = {}
    losses = run.parts.method.losses

    def watched(context: StepContext):
        seen.setdefault(context.step, set()).update(context.batch.views)
        return losses(context)

    run.parts.method.losses = watched
    run.fit()
    assert all(held not in views for step, views in seen.items() if step < 40)
    assert any(held in views for step, views in seen.items() if step >= 40)


class FourTimes(Sampler):
    """A schedule: one view for each step."""

    is_schedule = True

    def __init__(self) -> None:
        self.position = 0

    def next(self) -> tuple[int, ...]:
        self.position += 1
        return (self.position - 1,)

    def peek(self, count: int) -> tuple[int, ...]:
        return tuple(range(self.position, self.position + count))

    def state_dict(self) -> dict:
        return {"position": self.position}

    def load_state_dict(self, state) -> None:
        self.position = state["position"]


def test_a_sampler_that_is_a_schedule_is_never_ahead_of_it(tmp_path):
    run = trainer(tmp_path)
    walk, sampler, seen = Walk(["0:0.500"], run.parts.data.views(Split.TRAIN)), FourTimes(), []
    step = 0
    while step < 4:
        seen.append(walk.next_views(sampler, step)[0])
        span, _ = walk.advance(4 - step)
        step += span
    assert seen == [0, 0, 1, 1, 2, 2, 3, 3]


def drawn(pace: list[str], sampler: Sampler, views: Views, updates: int) -> list[tuple[int, int]]:
    """The view of each update, and the one that was expected for it."""
    walk, found, step = Walk(pace, views), [], 0
    expected: int | None = None
    for _ in range(updates):
        (view,) = walk.next_views(sampler, step)
        found.append((view, view if expected is None else expected))
        expected = (*walk.coming_views(sampler, 4), -1)[0]
        step += walk.advance(1000)[0]
    return found


@pytest.mark.parametrize("pace", [[], ["3:2.000"], ["2:3.000"]])
@pytest.mark.parametrize("kind", ["a schedule", "uniform"])
def test_views_that_are_loaded_ahead_are_those_of_the_next_updates(tmp_path, pace, kind):
    views = trainer(tmp_path).parts.data.views(Split.TRAIN)
    sampler = FourTimes() if kind == "a schedule" else UniformSampler(len(views), 1, seed=3)
    found = drawn(pace, sampler, views, 3 * len(views))
    # Decisions are for updates that come: what was loaded before one is for the earlier pace.
    changed = {int(text.partition(":")[0]) for text in pace}
    assert all(a == b for update, (a, b) in enumerate(found) if update not in changed)


def test_a_sampler_without_a_schedule_shows_every_view_of_an_epoch_at_any_pace(tmp_path):
    views = trainer(tmp_path).parts.data.views(Split.TRAIN)
    sampler = UniformSampler(len(views), 1, seed=3)
    seen = [view for view, _ in drawn(["0:2.000"], sampler, views, len(views))]
    assert sorted(seen) == list(range(len(views)))


def test_in_haste_nothing_is_loaded_ahead(tmp_path):
    views = trainer(tmp_path).parts.data.views(Split.TRAIN)
    walk = Walk(["1:500.000"], views)
    walk.advance(1000)
    walk.next_views(UniformSampler(len(views), 1, seed=3), 0)
    assert walk.coming_views(UniformSampler(len(views), 1, seed=3), 4) == ()


@pytest.mark.parametrize("pace", [["10:4.500"], ["10:1.000"]])
def test_checkpoints_are_written_in_haste_as_always(tmp_path, pace):
    written = []

    class Watching(Callback):
        def on_checkpoint(self, step, path) -> None:
            written.append(step)

    trainer(tmp_path, Watching(), pace=pace, checkpoint_every="10").fit()
    assert len(written) == 7, "at the start, and then one for every ten steps"


def test_views_that_are_held_back_are_given_back_before_the_end_without_a_goal(tmp_path):
    views = trainer(tmp_path).parts.data.views(Split.TRAIN)
    walk = Walk([], views, held_back=2)
    assert walk.held_back.views
    for step in range(20):
        walk.advance(1)
        walk.decide(step + 1, 20, 100, 1.0, lambda chosen: 0.0)
    assert walk.pace.texts == ("18:1.000:all-views",)


def test_a_run_of_another_length_has_the_usual_pace_and_all_views(tmp_path):
    views = trainer(tmp_path).parts.data.views(Split.TRAIN)
    walk = Walk(["3:0.500"], views, held_back=2)
    for _ in range(3):
        walk.advance(20)
    walk.unhurried()
    for step in range(4, 21):  # Also where the end, before which views are given back, is near.
        walk.advance(1)
        walk.decide(step, 20, 100, 1.0, lambda chosen: 0.0)
    assert walk.pace.texts == ("3:0.500", "4:1.000:all-views")
