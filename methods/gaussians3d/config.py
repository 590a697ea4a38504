"""Settings of method 3dgs; the defaults are those of Kerbl et al. 2023."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import MethodConfig
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.optim_config import OptimConfig
from gsfw.core.ranges import number
from gsfw.core.step_settings import steps_field

if TYPE_CHECKING:
    from gsfw.core.method import Method

MAX_SH_DEGREE = 4
"""Highest degree of the rasterizers."""
PAPER_STEPS = 30_000
"""Steps for which the rates of Kerbl et al. 2023 are meant."""
MOST_FACTOR = 5.0
"""Largest factor of the rates of short runs. At 300 steps 6 is no better than 3 or 4."""


@dataclass
class StaticGaussiansOptim(OptimConfig):
    """Learning rates of the columns."""

    means_lr: float = number(1.6e-4, at_least=0, below=math.inf)
    """Rate of positions at the first step, times the scene's extent."""
    means_lr_final: float = number(1.6e-6, at_least=0, below=math.inf)
    """Rate of positions once it has decayed, log-linearly, times the scene's extent."""
    means_lr_steps: int = steps_field(PAPER_STEPS)
    """Steps over which the rate of positions decays."""
    scales_lr: float = number(5e-3, at_least=0, below=math.inf)
    """Rate of the logarithms of the scales."""
    quats_lr: float = number(1e-3, at_least=0, below=math.inf)
    """Rate of the quaternions."""
    opacities_lr: float = number(5e-2, at_least=0, below=math.inf)
    """Rate of the logits of the opacities."""
    sh_dc_lr: float = number(2.5e-3, at_least=0, below=math.inf)
    """Rate of the constant colour coefficient."""
    sh_rest_lr: float = number(1.25e-4, at_least=0, below=math.inf)
    """Rate of the view-dependent colour coefficients."""
    factor: float | Literal["auto"] = 1.0
    """Factor of the rates of positions, scales, rotations, opacities and colours. auto: the cube
    root of 30,000 over means_lr_steps, 1 to 5, since shorter runs have fewer steps to get as far.
    Rates of a method of its own, such as those of motion, keep theirs."""

    def learning_rates(self, extent: float) -> dict[str, LearningRate]:
        """Learning rate of every column, by name."""
        means = LearningRate(
            self.means_lr * extent, self.means_lr_final * extent, self.means_lr_steps
        )
        rates = {
            "means": means,
            "log_scales": LearningRate(self.scales_lr),
            "quats": LearningRate(self.quats_lr),
            "opacity_logits": LearningRate(self.opacities_lr),
            "sh_dc": LearningRate(self.sh_dc_lr),
            "sh_rest": LearningRate(self.sh_rest_lr),
        }
        factor = self._length_factor() if self.factor == "auto" else self.factor
        return {name: rate.times(factor) for name, rate in rates.items()}

    def _length_factor(self) -> float:
        ratio = PAPER_STEPS / max(self.means_lr_steps, 1)
        return min(max(ratio ** (1 / 3), 1.0), MOST_FACTOR)


@dataclass
class BandsConfig:
    """Schedule and number of adaptive bands of spherical harmonics (sh=adaptive)."""

    share: float = number(0.45, above=0, at_most=1)
    """Fraction of the colour floats of sh_degree at the end, the constant ones included."""
    signal: float = number(2.0, at_least=1)
    """A splat gains a band above this signal-to-noise ratio of the direction dependence of its
    gradients, which is 1 for a splat that needs none; higher: fewer bands."""
    rate: float = number(4.0, above=0, below=math.inf)
    """Initial rate of the bands, relative to optim.sh_rest_lr (times optim.factor), their final
    rate: a band on trial has little time to show its worth."""
    every: int = steps_field(1000, at_least=2, floor=50)
    """Steps between rounds in which splats gain or lose a band."""
    grow_stop: int = steps_field(5000)
    """Splats gain bands up to this step, and lose them after it."""
    stop: int = steps_field(15_000)
    """No splat gains or loses a band after this step."""


@dataclass
class GaussiansConfig(MethodConfig):
    """Settings of every method with canonical 3D Gaussians: colours, loss, and initialisation."""

    renamed: ClassVar[Mapping[str, str]] = {"sh=same": "sh=uniform"}

    acts_with: ClassVar[Mapping[str, str]] = {
        "bands": "sh=adaptive",
        "squared_weight": "squared_steps>0",
    }

    sh_degree: int = number(3, at_least=0, at_most=MAX_SH_DEGREE)
    """Highest degree of the spherical harmonics, 0 (one colour for all directions) to 4."""
    sh: Literal["uniform", "adaptive", "0", "1", "2", "3", "4"] = "uniform"
    """uniform: every splat has the bands up to sh_degree; adaptive: each only those that its colour
    requires; a number is short for sh=uniform and that sh_degree."""
    bands: BandsConfig = field(default_factory=BandsConfig)
    sh_degree_interval: int = steps_field(1000)
    """Steps after which one more degree is trained; 0: all from the first step."""
    ssim_weight: float = number(0.2, at_least=0, at_most=1)
    """Weight of 1 - SSIM in the loss; the mean absolute difference has the rest."""
    squared_steps: int = steps_field(0)
    """Steps in which the loss has the mean squared difference instead of the absolute one, for
    scenes that move: where something is present less than half of the time, the absolute
    difference is least without it."""
    squared_weight: float = number(1.0, above=0, below=math.inf)
    """Weight of squared differences. With 2 their gradient is that of absolute ones at a
    difference of 1/4, so that more splats grow."""
    opacity_penalty: float = number(0.0, at_least=0, below=math.inf)
    """Weight of the mean opacity in the loss, for captures of few cameras (0.03); 0: none."""
    init_opacity: float = number(0.1, above=0, below=1)
    """Initial opacity of every splat."""
    init_scale: float = number(1.0, above=0)
    """Initial size, times the mean distance to the three nearest points."""
    random_points: int | Literal["auto"] = "auto"
    """Number of splats of a random initialisation. auto: a quarter of the pixels of a training
    view, 5000 to 100,000: more would mostly be removed again, which short runs do not reach."""
    random_region: Literal["auto", "object", "surroundings"] = "auto"
    """Region of random splats: around the point that the cameras look at (object), or all around
    the cameras (surroundings). auto: object if images have alpha."""
    optim: StaticGaussiansOptim = field(default_factory=StaticGaussiansOptim)

    def __post_init__(self) -> None:
        """Expand sh=2 to sh=uniform sh_degree=2."""
        if self.sh.isdigit():
            self.sh, self.sh_degree = "uniform", int(self.sh)

    def check(self) -> None:
        """Check the values of every run, and this method's own.

        Raises:
            ConfigError: a value is wrong; names the key, the expected and the given value.
        """
        super().check()
        if self.bands.stop < self.bands.grow_stop:
            raise ConfigError(
                f"bands.stop={self.bands.stop}: expected at least "
                f"bands.grow_stop={self.bands.grow_stop}.",
                f"Give bands.grow_stop={self.bands.stop} or less, or a larger bands.stop.",
            )
        factor = self.optim.factor
        if factor != "auto" and not 0 < factor < math.inf:
            raise ConfigError(f"optim.factor={factor}: expected auto, or a finite number above 0.")
        if self.random_points != "auto" and self.random_points < 1:
            raise ConfigError(
                f"random_points={self.random_points}: expected auto, or a number of at least 1."
            )

    def needs(self) -> Needs:
        """Ragged colours if splats have degrees of their own."""
        ragged = frozenset({Feature.RAGGED_SH} if self.sh == "adaptive" else ())
        return super().needs() | Needs(features=ragged)

    def learning_rates(self, extent: float) -> dict[str, LearningRate]:
        """Learning rate of every column, by name."""
        rates = self.optim.learning_rates(extent)
        if self.sh == "adaptive":
            rate = rates["sh_rest"].initial
            rates["sh_rest"] = LearningRate(self.bands.rate * rate, rate, self.steps)
        return rates


@dataclass
class StaticGaussiansConfig(GaussiansConfig):
    """Static 3D Gaussians (Kerbl et al. 2023)."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "fast": {"steps": 7_000, "sh_degree": 2},
        "default": {},
        "high": {"strategy": "mcmc", "strategy.cap_max": 2_000_000},
    }
    """fast: a quarter of the steps, every schedule in proportion, and 27 instead of 48 colour
    coefficients; default: the paper; high: twice the splats that MCMC usually gets."""

    optim: StaticGaussiansOptim = field(
        default_factory=lambda: StaticGaussiansOptim(factor="auto", cooldown=0.2)
    )
    ignore_time: bool = False
    """Train on a capture of several times as if it had one, by squared differences: moving objects
    become blurred."""

    def build(self) -> Method:
        """Build the method."""
        from gsfw.methods.gaussians3d.method import StaticGaussiansMethod

        return StaticGaussiansMethod(self)
