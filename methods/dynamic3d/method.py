"""Method dynamic3dgs: Luiten et al. 2024, "Dynamic 3D Gaussians".

Gaussians are built on the pictures of the first time; on those of each later time they only move
and turn (and change their constant colour a little), with neighbours held together by rigidity.

Where we differ from the released code: no masks are needed, as all rows take part in rigidity and
there are neither background nor floor terms; colours have spherical harmonics; learning rates
start anew at every time and decay within it, so that short runs reach as far as long ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.dynamic3d.model import Regularization, TrackedGaussians
from gsfw.methods.moving.method import MovingMethod

if TYPE_CHECKING:
    from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig

MOVING = ("means", "quats")
"""Columns that begin with fresh moments at every time."""


class TrackedGaussiansMethod(MovingMethod):
    """Builds the first time, then follows it through the others, in order."""

    name = "dynamic3dgs"

    def __init__(self, config: TrackedGaussiansConfig) -> None:
        super().__init__(config)
        self._config = config
        self._extent, self._num_times = 1.0, 0
        self._first_step: int | None = None
        self._planned_steps = 0

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> TrackedGaussians:
        """Gaussians at the splats of a file, at points of the first time, or at random."""
        config = self._config
        self._extent, self._num_times = scene.extent, scene.num_times
        canonical = self._static.build_model(first_points(scene), operators, generator, initial)
        regularization = Regularization(
            config.rigid,
            config.rotation,
            config.isometry,
            config.color_change,
            config.neighbors,
            config.neighbors_per_step,
        )
        return TrackedGaussians(canonical, regularization, config.colors == "soft")

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Go on to the next time when the views do; let rates and the SH degree follow.

        Raises:
            ConfigError: views come in another order than that of time.
        """
        assert isinstance(model, TrackedGaussians)
        assert time is not None
        self._static.prepare(step, model.canonical, optimizer, time)
        current = model.trajectory.current
        if current is not None and time < current:
            raise ConfigError(
                f"method 'dynamic3dgs' follows a scene from each time to the next, but step "
                f"{step} shows time {time:.4g} after {current:.4g}: the sampler goes back.",
                "Use sampler=sequential, which is this method's own.",
            )
        if current is None or time > current:
            model.advance_(time)
            if model.tracking:
                self._start(step, model, optimizer)
        if self._first_step is not None:
            self._set_rates(model)

    def _start(self, step: int, model: TrackedGaussians, optimizer: Optimizer) -> None:
        """Begin to track a time.

        It is taken to be as long as the one before it, and the first of them to have an even share
        of the run: how many times are trained on is not known, as some may be held out.
        """
        if self._first_step is None:
            self._planned_steps = max((self._config.steps - step) // (self._num_times - 1), 1)
        else:
            self._planned_steps = step - self._first_step
        self._first_step = step
        optimizer.reset(MOVING)
        moving = {*MOVING, "sh_dc"} if self._config.colors == "soft" else {*MOVING}
        optimizer.freeze(model.columns().keys() - moving)

    def _set_rates(self, model: TrackedGaussians) -> None:
        """Rates decay within a time, from where its views began."""
        assert self._first_step is not None
        optim = self._config.optim
        for column, rate in (
            (model.canonical.means, optim.tracked_means_lr * self._extent),
            (model.canonical.quats, optim.tracked_quats_lr),
        ):
            column.learning_rate = LearningRate(
                rate, rate * optim.tracked_decay, self._planned_steps, self._first_step
            )

    def state_dict(self) -> dict[str, Any]:
        """That of method 3dgs, and when the current time began."""
        return {
            **super().state_dict(),
            "first_step": self._first_step,
            "planned_steps": self._planned_steps,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with it."""
        super().load_state_dict(state)
        self._first_step = state["first_step"]
        self._planned_steps = state["planned_steps"]


def first_points(scene: Scene) -> Scene:
    """The scene with the points of its first time only, where the data say when points were seen.

    The others need not be where they are at the first time, and nothing can move them there.
    """
    times = scene.point_times
    if times is None or not bool(times.isfinite().any()):
        return scene
    tolerance = 0.5 / max(scene.num_times - 1, 1)
    chosen: Tensor = times <= times[times.isfinite()].min() + tolerance
    return replace(
        scene,
        points=scene.points[chosen],
        point_colors=scene.point_colors[chosen],
        point_times=times[chosen],
    )
