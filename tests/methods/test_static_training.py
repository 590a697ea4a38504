"""Training with static=auto: resuming, what the summary says, and coming back."""

from dataclasses import replace

import pytest
import torch
from support.fast_rasterizer import fast_rasterizer
from support.gaussians import no_contributions, no_views
from support.mixed_rows import check_rows
from support.moving_runs import train
from support.moving_scene import WHITE, camera_at, two_balls
from support.moving_splats import moving_scene
from support.resuming import resumed_to_the_same_bits

from gsfw.commands.main import main
from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.table import SplatTable
from gsfw.methods.spacetime.config import SpacetimeConfig

AUTO = ("static=auto", "static_start=2", "static_every=5", "static_signal=1.2")
RANDOM = ("init=random", "random_points=150")
SHORT = (
    *("steps=30", "checkpoint_every=15", "eval_every=0"),
    *("strategy.refine_start=4", "strategy.refine_every=10"),
)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["adc", "error", "mcmc"])
@pytest.mark.parametrize(
    "method",
    [("method=spacetime",), ("method=4d-rotor",), ("method=4dgs", "coarse_steps=4")],
    ids=["spacetime", "4d-rotor", "4dgs"],
)
def test_a_run_with_rows_of_both_kinds_resumes_to_the_same_bits(tmp_path, method, strategy):
    arguments = (*method, *RANDOM, *AUTO, *SHORT, f"strategy={strategy}", "seed=3")
    figures = train(tmp_path / "whole", *arguments)
    assert figures["num_gaussians"] != 150, "rows must have been added or removed"
    assert figures["static_rows"] > 0
    assert figures["moving_rows"] > 0
    assert figures["static_rows"] + figures["moving_rows"] == figures["num_gaussians"]
    assert figures["optimizer_bytes"] == 2 * figures["model_bytes"]
    parts = resumed_to_the_same_bits(tmp_path / "whole")
    for time in (0, 1):
        assert main(["export", str(parts.path), f"time={time}", f"out={tmp_path / 'a.ply'}"]) == 0


def test_points_that_know_their_times_begin_as_things_that_come_and_go():
    known = moving_scene(8, point_times=torch.linspace(0, 1, 8))
    for scene, moving in ((known, 8), (moving_scene(8), 0)):
        method = SpacetimeConfig(static="auto").build()
        model = method.build_model(scene, Operators(), torch.Generator(), None)
        assert len(model.still.moving()) == moving


# Coming back.


class Course:
    """Two balls and a camera; one ball begins to move in the second half of the sequence."""

    def __init__(self, **settings) -> None:
        config = SpacetimeConfig(sh_degree=0, static="auto", static_every=40, static_start=0)
        config.optim.motion_lr = 3e-3
        config.squared_steps = 0  # The schedule of a long run would never come to its sharp loss.
        self.config = replace(config, **settings)
        self.method, self.generator = self.config.build(), torch.Generator().manual_seed(0)
        self.scene = replace(moving_scene(), extent=1.0)
        self.truth, self.rasterizer = two_balls(), fast_rasterizer()
        self.model = self.method.build_model(
            self.scene, Operators(), self.generator, self.truth.splats()
        )
        self.optimizer = Optimizer(self.model, Operators(), OptimizerSettings())
        self.table, self.step = SplatTable(self.model, self.optimizer), 0
        self.refiners = Refiners(self.method.refiners(self.scene, self.model))
        self.camera = camera_at(0.0)

    def image(self, time: float) -> torch.Tensor:
        with torch.no_grad():
            drifted = self.truth.splats(torch.tensor(max(time - 0.5, 0.0)))
            return self.rasterizer.render(drifted, self.camera, WHITE).color

    def one_step(self, time: float) -> float:
        camera = replace(self.camera, time=torch.tensor([time]))
        batch = Batch(self.image(time), camera, (0,))
        self.method.prepare(self.step, self.model, self.optimizer, time)
        splats = self.model.splats(batch.time)
        output = self.rasterizer.render(splats, camera, WHITE)
        context = StepContext(
            self.step, 1000, batch, splats, output, batch.images,
            len(self.table), 1.0, 1.0, Operators(), no_views, no_contributions,
        )  # fmt: skip
        losses = {**self.method.losses(context), **self.model.regularizers(context)}
        loss = torch.stack(list(losses.values())).sum()
        self.refiners.before_backward(context, self.model)
        loss.backward()
        self.optimizer.step(self.step, torch.tensor(True))
        self.model.project_()
        self.optimizer.zero_gradients()
        self.refiners.refine(self.step, 1000, self.table, self.model, self.generator)
        self.step += 1
        return float(loss.detach())

    def train(self, times: torch.Tensor, steps: int) -> float:
        """Mean loss of the last quarter."""
        order = torch.randint(len(times), (steps,), generator=self.generator).tolist()
        losses = [self.one_step(float(times[index])) for index in order]
        return sum(losses[-steps // 4 :]) / (steps // 4)


@pytest.mark.slow
def test_a_ball_that_begins_to_move_late_comes_back_and_the_other_does_not():
    course = Course()
    course.train(torch.linspace(0.0, 0.5, 6), 120)
    assert course.model.still.moving().tolist() == [], "nothing has moved so far"
    blurred = course.train(torch.linspace(0.0, 1.0, 11), 40)
    followed = course.train(torch.linspace(0.0, 1.0, 11), 240)
    assert course.model.still.moving().tolist() == [0]
    assert followed < 0.4 * blurred
    check_rows(course.model, course.table)


def test_nothing_is_looked_at_before_its_time_or_between():
    course = Course(static_start=10, static_every=4)
    terms = course.model.still.terms.values
    terms[:, 0] = 100.0
    waited = []
    for _ in range(20):
        course.one_step(0.0)
        waited.append(100 - int(course.model.still.terms.values[0, 0]))
    assert waited == [0] * 11 + [1] * 4 + [2] * 4 + [3]


# What it costs.


@pytest.mark.slow
def test_a_row_that_stands_still_costs_no_quality():
    times = torch.linspace(0.0, 1.0, 11)
    loss = {static: Course(static=static).train(times, 200) for static in ("none", "auto")}
    assert loss["auto"] < 1.1 * loss["none"]
