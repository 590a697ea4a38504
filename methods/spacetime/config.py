"""Settings of method spacetime; the defaults are those of Li et al. 2024."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.core.capabilities import Needs
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.ranges import number
from gsfw.core.step_settings import steps_field
from gsfw.methods.moving.config import PAPER_RATES, MovingConfig, MovingOptim

if TYPE_CHECKING:
    from gsfw.core.method import Method

MAX_ORDER = 5
"""Largest degree: higher powers of a time within [-1, 1] are too similar."""
ENOUGH_MOTION_STEPS = 2400
"""Steps that paths need at the usual rate. At 2.5 times of it, robot loses 0.4 dB in 2000 steps."""
MOST_MOTION_FACTOR = 10.0
"""Largest factor of the rate of paths in short runs. At 600 steps, 30 is worse by 0.4 dB."""


@dataclass
class SpacetimeOptim(MovingOptim):
    """Learning rates of the columns."""

    motion_lr: float = number(2.8e-4, at_least=0, below=math.inf)
    """Rate of the motion's coefficients at the first step, times the scene's extent; it decays as
    that of positions does."""
    motion_factor: float | Literal["auto"] = "auto"
    """Factor of motion_lr. auto: the square of 2400 over means_lr_steps, 1 to 10, since paths begin
    at rest and short runs leave them few steps."""
    spins_lr: float = number(1e-4, at_least=0, below=math.inf)
    """Rate of the rates at which quaternions change."""
    time_centers_lr: float = number(1e-4, at_least=0, below=math.inf)
    """Rate of the temporal centres, in sequences."""
    log_durations_lr: float = number(0.03, at_least=0, below=math.inf)
    """Rate of the logarithms of the durations."""
    features_lr: float = number(2.5e-3, at_least=0, below=math.inf)
    """Rate of the features that depend on the direction (colors=features)."""
    feature_rates_lr: float = number(1e-3, at_least=0, below=math.inf)
    """Rate of the features that change with time (colors=features)."""
    decoder_lr: float = number(1e-4, at_least=0, below=math.inf)
    """Rate of the network that decodes features (colors=features)."""

    def learning_rates(self, extent: float) -> dict[str, LearningRate]:
        """Learning rate of every column and of the decoder, by name."""
        rates = super().learning_rates(extent)
        decay = self.means_lr_final / self.means_lr if self.means_lr > 0 else 1.0
        factor = self._short_motion() if self.motion_factor == "auto" else self.motion_factor
        rate = factor * self.motion_lr * extent
        motion = LearningRate(rate, rate * decay, self.means_lr_steps)
        return rates | {
            "motion": motion,
            "spins": LearningRate(self.spins_lr),
            "time_centers": LearningRate(self.time_centers_lr),
            "log_durations": LearningRate(self.log_durations_lr),
            "features": LearningRate(self.features_lr),
            "feature_rates": LearningRate(self.feature_rates_lr),
            "decoder": LearningRate(self.decoder_lr),
        }

    def _short_motion(self) -> float:
        ratio = ENOUGH_MOTION_STEPS / max(self.means_lr_steps, 1)
        return min(max(ratio**2, 1.0), MOST_MOTION_FACTOR)


@dataclass
class SpacetimeConfig(MovingConfig):
    """Gaussians on polynomial paths with a temporal opacity (Li et al. 2024)."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {
            "datamanager.moving": True,
            "strategy.reset_every": 0,
            "strategy.grow_time_gradient": 5e-5,
            "strategy.max_gaussians": 360_000,
        },
        "paper": {**PAPER_RATES, "optim.motion_factor": 1.0},
        "features": {"colors": "features"},
        "freetime": {
            "motion_order": 1,
            "spin": False,
            "lifetime_reg": 1e-2,
            "strategy": "mcmc",
            "strategy.opacity_reg": 0.0,
            "strategy.gradient_share": 0.5,
        },
    }
    """default: cubic paths, spherical harmonics, growth by the gradient of temporal centres too,
    no opacity resets, which harm motion, and at most 360,000 rows (the paper has about 240,000 for
    50 frames: 200 MB, six models, 140 bytes a row; without a limit robot ended with 660,000);
    features: the paper's full model, whose colours a network decodes; freetime: straight paths,
    relocation to where gradients are, and opacities paid for by the time they are seen (FreeTimeGS,
    Wang et al. 2025).

    Measured on the built-in moving scene (120 x 90, 800 steps, PSNR / where things move): growth by
    time gradients 29.67 / 23.59 to 30.08 / 24.29 dB with 12 % more rows (seed 42), 29.94 / 24.00 to
    30.30 / 24.52 dB with 14 % (seed 7); relocation by gradient, for freetime, 27.78 / 21.27 to
    27.94 / 21.43 dB with as many. Not chosen: max_rounds=3, 29.40 / 23.32 dB with 13 % fewer rows;
    prune_lifetime=1, 29.67 / 23.67 dB with 2 % fewer. On dynamic/robot (downscale=8, 1000 steps,
    random_points=8000): growth by time gradients 23.99 to 23.92 dB with 3 % more rows, relocation
    by gradient 22.98 to 23.11 dB."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "motion_start": "motion=adaptive",
        "motion_every": "motion=adaptive",
        "motion_tolerance": "motion=adaptive",
        "optim.spins_lr": "spin=true",
        "optim.features_lr": "colors=features",
        "optim.feature_rates_lr": "colors=features",
        "optim.decoder_lr": "colors=features",
    }

    squared_steps: int = steps_field(15_000)
    """Steps in which the loss has the mean squared difference instead of the absolute one, under
    which things vanish that are present less than half of the time."""
    squared_weight: float = number(2.0, above=0, below=math.inf)
    """Weight of squared differences. With 2 their gradient is that of absolute ones at a
    difference of 1/4, so that as many splats grow."""
    motion_order: int = number(3, at_least=1, at_most=MAX_ORDER)
    """Degree of the polynomials along which splats move, 1 to 5."""
    spin: bool = True
    """Rotate splats too, by quaternions that are linear in time."""
    motion: Literal["full", "adaptive"] = "full"
    """full: every splat that moves has a path of motion_order, a rotation and a temporal opacity;
    adaptive: all start so, and lose those that have, relative to its size, no effect."""
    motion_start: int = steps_field(15_000)
    """Steps before any splat loses parameters of time (motion=adaptive)."""
    motion_every: int = steps_field(4000, at_least=1, floor=50)
    """Steps between rounds that remove temporal parameters (motion=adaptive)."""
    motion_tolerance: float = number(0.1, above=0, below=1)
    """Tolerated motion of a splat by the removal of a parameter, as part of its size, and tolerated
    change of its opacity, shape and colour (motion=adaptive)."""
    colors: Literal["sh", "features"] = "sh"
    """Spherical harmonics, or features that a network decodes on the screen (splat files then hold
    the base colours, which are the same from everywhere)."""
    init_duration: float = number(0.7, above=0, at_most=10)
    """Standard deviation in time of every splat at the start, in sequences."""
    lifetime_reg: float = number(0.0, at_least=0)
    """Weight of the mean opacity of all splats at the time of a step (FreeTimeGS: 0.01)."""
    optim: SpacetimeOptim = field(default_factory=SpacetimeOptim)

    def build(self) -> Method:
        """Build the method."""
        from gsfw.methods.spacetime.method import SpacetimeMethod

        return SpacetimeMethod(self)

    def check(self) -> None:
        """Check the values of every run, and this method's own.

        Raises:
            ConfigError: a value is wrong; names the key, the expected and the given value.
        """
        super().check()
        factor = self.optim.motion_factor
        if factor != "auto" and not 0 < factor < math.inf:
            raise ConfigError(
                f"optim.motion_factor={factor}: expected auto, or a finite number above 0."
            )

    def needs(self) -> Needs:
        """Six channels besides the colours if features are rendered."""
        needs = super().needs()
        if self.colors == "sh":
            return needs
        return needs | Needs(extra_channels=6)
