"""Settings of method 4d-rotor; the defaults are those of Duan et al. 2024, where they fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.learning_rate import LearningRate
from gsfw.core.ranges import number
from gsfw.core.step_settings import steps_field
from gsfw.methods.moving.config import PAPER_RATES, MovingConfig, MovingOptim

if TYPE_CHECKING:
    from gsfw.core.method import Method

MAX_INIT_DURATION = 10.0
"""Longest duration of a model."""


@dataclass
class SlicedGaussiansOptim(MovingOptim):
    """Learning rates of the columns."""

    means_lr_steps: int = steps_field(20_000)
    """Steps over which the rate of positions decays."""
    time_quats_lr: float = number(1e-3, at_least=0, below=math.inf)
    """Rate of the second quaternion of each rotation."""
    time_centers_lr: float = number(1.6e-4, at_least=0, below=math.inf)
    """Rate of temporal centres at the first step, in sequences; decays as that of positions."""
    log_durations_lr: float = number(5e-3, at_least=0, below=math.inf)
    """Rate of the logarithms of the scales along the fourth axis."""

    def learning_rates(self, extent: float) -> dict[str, LearningRate]:
        """Learning rate of every column, by name."""
        decay = self.means_lr_final / self.means_lr if self.means_lr > 0 else 1.0
        centers = LearningRate(
            self.time_centers_lr, self.time_centers_lr * decay, self.means_lr_steps
        )
        return super().learning_rates(extent) | {
            "time_quats": LearningRate(self.time_quats_lr),
            "time_centers": centers,
            "log_durations": LearningRate(self.log_durations_lr),
        }


@dataclass
class SlicedGaussiansConfig(MovingConfig):
    """Gaussians of space and time, sliced at an instant (Duan et al. 2024)."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {
            "datamanager.moving": True,
            "strategy.reset_every": 0,
            "strategy.absgrad": True,
            "strategy.grow_time_gradient": 5e-5,
            "strategy.max_gaussians": 360_000,
            "sampler.views_per_step": 2,
        },
        "paper": {**PAPER_RATES, "strategy.absgrad": False},
    }
    """Two views of any times in a step, growth by absolute gradients (0.3 dB on average of six
    scenes, docs/results/moving-scenes-settings.md#growth) and by the gradient of temporal centres,
    no opacity resets, which harm motion, and at most 360,000 rows, as in method 4dgs: of 1.06
    million rows, 500,000 lose 0.2 dB on Neural 3D Video and 165,000 lose 0.5 dB (FreeTimeGS, Wang
    et al. 2025). On the built-in moving scene (120 x 90, 500 steps, seed 42) growth by temporal
    centres gives 0.15 dB, 0.30 dB where things move, and 17 % more rows. paper: the rates and the
    growth of Kerbl et al. 2023."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "neighbors_every": "velocity_reg>0",
    }

    steps: int = 20_000
    """Training steps. Schedules follow in proportion, unless rescale=false."""
    rotation: Literal["rotor", "two-quaternions"] = "rotor"
    """Form in which 4D rotations are trained; two-quaternions is that of Yang et al. 2024."""
    init_duration: float = number(0.2, above=0, at_most=MAX_INIT_DURATION)
    """Standard deviation in time of every splat at the start: 0.2 covers half of the sequence."""
    entropy_reg: float = number(1e-3, at_least=0)
    """Weight of the opacities' entropy, which makes splats opaque or vanish."""
    velocity_reg: float = number(0.05, at_least=0)
    """Weight of the difference of velocities, in extents per sequence, from neighbours'."""
    neighbors_every: int = steps_field(100, at_least=1, floor=50)
    """Steps between searches of each splat's neighbours."""
    optim: SlicedGaussiansOptim = field(default_factory=SlicedGaussiansOptim)

    def build(self) -> Method:
        """Build the method."""
        from gsfw.methods.rotor4d.method import SlicedGaussiansMethod

        return SlicedGaussiansMethod(self)

    def needs(self) -> Needs:
        """Splats with covariances."""
        return super().needs() | Needs(features=frozenset({Feature.COVARIANCES}))
