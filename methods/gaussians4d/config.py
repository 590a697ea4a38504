"""Settings of method 4dgs: those of Wu et al. 2024, with defaults that short runs measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.ranges import number
from gsfw.core.step_settings import Rescaled, steps_field
from gsfw.methods.moving.config import PAPER_RATES, MovingConfig, MovingOptim

if TYPE_CHECKING:
    from gsfw.core.method import Method

MAX_LOG2_ROWS = 24
"""Largest logarithm of the rows of a hash table, which has 32-bit indices; Mueller et al.: 24."""


@dataclass
class DeformationOptim(MovingOptim):
    """Learning rates of the canonical Gaussians and of the field.

    The rates of the field are independent of the scene's extent, because the field is: the paper's
    rates are multiplied by the extent, about 5 for its synthetic scenes. With the smoother planes
    that are the default here, planes learn well at three times their rate, and decay to a
    thirtieth; the networks have the paper's, and decay to a tenth, as its captured scenes do.
    """

    grid_lr: float = number(2.4e-2, at_least=0, below=math.inf)
    """Rate of planes or tables at the first fine step."""
    grid_lr_final: float = number(8e-4, at_least=0, below=math.inf)
    """Rate of planes or tables once it has decayed, log-linearly."""
    network_lr: float = number(8e-4, at_least=0, below=math.inf)
    """Rate of the networks at the first fine step."""
    network_lr_final: float = number(8e-5, at_least=0, below=math.inf)
    """Rate of the networks once it has decayed, log-linearly."""
    field_lr_steps: int = steps_field(20_000)
    """Fine steps over which the rates of planes, tables and networks decay."""

    def field_rates(self, start: int) -> dict[str, LearningRate]:
        """Learning rates of the field; zero before the step ``start``."""
        steps = self.field_lr_steps
        return {
            "grid": LearningRate(self.grid_lr, self.grid_lr_final, steps, start),
            "network": LearningRate(self.network_lr, self.network_lr_final, steps, start),
        }


@dataclass
class HexPlaneConfig:
    """Sizes of the planes, and weights of their regularisers."""

    channels: int = number(32, at_least=1)
    """Features per cell."""
    resolution: int = number(32, at_least=2)
    """Cells along x, y and z, at the coarsest resolution."""
    multipliers: tuple[int, ...] = (1, 2)
    """The resolutions, as multiples of the coarsest; time has the same cells at all."""
    times: int | Literal["auto"] = "auto"
    """Cells along time. auto: a quarter of the training views, at most two for each captured time;
    0: one for each captured time; both at most 100."""
    width: int = number(64, at_least=1)
    """Width of the network's shared layers."""
    depth: int = number(1, at_least=1)
    """Shared layers between the planes and those of each quantity."""
    head_width: int | Literal["auto"] = "auto"
    """Width of the hidden layer of each quantity; auto: width, without shared layers 0; 0: none,
    its values are linear in the last shared layer."""
    plane_tv: float = number(1e-2, at_least=0, below=math.inf)
    """Weight of the total variation of space planes; 0: none."""
    time_smoothness: float = number(1e-2, at_least=0, below=math.inf)
    """Weight of squared second differences of time planes along time; 0: none."""
    time_l1: float = number(1e-4, at_least=0, below=math.inf)
    """Weight of the distance of time planes from 1, which is no motion; 0: none."""


@dataclass
class MlpConfig:
    """Sizes of the network (Yang et al. 2024)."""

    width: int = number(256, at_least=1)
    """Width of the layers."""
    depth: int = number(8, at_least=1)
    """Number of layers; the input is concatenated again in the middle."""
    frequencies: int = number(10, at_least=0)
    """Frequencies of each coordinate, each twice the one before."""
    time_frequencies: int = number(6, at_least=0)
    """Frequencies of time, each twice the one before."""


@dataclass
class HashConfig:
    """Sizes of the tables (Mueller et al. 2022)."""

    levels: int = number(8, at_least=1)
    """Number of resolutions."""
    features: int = number(4, at_least=1)
    """Features per row of a table; the network has levels times as many inputs."""
    log2_rows: int = number(15, at_least=1, at_most=MAX_LOG2_ROWS)
    """Logarithm to base 2 of the largest number of rows of a table."""
    coarsest: int = number(8, at_least=1)
    """Cells along an axis at the coarsest resolution."""
    finest: int = number(128, at_least=1)
    """Cells along an axis at the finest resolution."""
    times: int | Literal["auto"] = "auto"
    """Most cells along time: auto, 0 or a number, as hexplane.times."""
    width: int = number(64, at_least=1)
    """Width of the network's shared layers."""
    depth: int = number(1, at_least=1)
    """Shared layers between the tables and those of each quantity."""
    head_width: int | Literal["auto"] = "auto"
    """Width of the hidden layer of each quantity; auto: width, without shared layers 0; 0: none,
    its values are linear in the last shared layer."""


DEFAULT_STEPS = 23_000
"""Steps of Wu et al. 2024 for synthetic scenes: 3000 coarse ones and 20,000 fine ones."""

FIELD_COST = 2.2
"""Time of a step with the field over that of a static one, at 20,000 Gaussians and 200 x 200."""


def _of_40_000(steps: int) -> Rescaled:
    """A number of steps in a run of 40,000 (Yang et al.), in the units of a preset."""
    return Rescaled(round(steps * DEFAULT_STEPS / 40_000))


@dataclass
class DeformationConfig(MovingConfig):
    """Canonical Gaussians and a deformation field (Wu et al. 2024; Yang et al. 2024)."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {
            "datamanager.moving": True,
            "strategy.reset_every": 0,
            "strategy.max_gaussians": 360_000,
        },
        "paper": PAPER_RATES,
        "fast": {
            "steps": 7_000,
            "sh_degree": 2,
            "hexplane.channels": 16,
        },
        "mlp": {
            "steps": 40_000,
            "encoder": "mlp",
            "scale_change": "sum",
            "deform_opacity": False,
            "coarse_steps": _of_40_000(3000),
            "sh_degree_interval": _of_40_000(1000),
            "optim.means_lr_steps": _of_40_000(30_000),
            "optim.field_lr_steps": _of_40_000(37_000),
            "strategy.absgrad": True,
            "strategy.grow_absgrad": 7e-4,
            "strategy.refine_start": _of_40_000(500),
            "strategy.refine_every": _of_40_000(100),
            "strategy.refine_stop": _of_40_000(15_000),
        },
    }
    """default: Wu et al. 2024 with the released code's limit on the number of splats, without
    opacity resets, which hurt scenes that move, and with other defaults for the loss, the planes
    and their rate (docs/guides/moving-scenes.md); fast: a third of the steps, half the features;
    mlp: Yang et al. 2024, whose network is slow on a CPU. Its schedule is theirs, but opacities are
    not reset, and the rate of the network decays to a tenth, not to 1/500, with which short runs
    stop to learn."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "hexplane": "encoder=hexplane",
        "mlp": "encoder=mlp",
        "hash": "encoder=hash",
    }

    steps: int = DEFAULT_STEPS
    """Training steps. Schedules follow in proportion, unless rescale=false."""
    encoder: Literal["hexplane", "mlp", "hash"] = "hexplane"
    """Encoder of the field: planes, a network alone, or hash tables."""
    coarse_steps: int = steps_field(3000)
    """Steps of the training of static Gaussians, before the field is used."""
    scale_change: Literal["factor", "sum"] = "factor"
    """factor: the field multiplies scales (Wu et al.); sum: it adds to them (Yang et al.)."""
    deform_opacity: bool = True
    """Change opacities with time, for things that appear and vanish, as the paper does for captured
    scenes."""
    deform_sh: bool = False
    """Change colours with time, as the paper does for captured scenes."""
    squared_steps: int = steps_field(11_500, floor=500)
    """Steps in which the loss has the mean squared difference instead of the absolute one, under
    which things vanish that are present less than half of the time, before the field moves them."""
    squared_weight: float = number(2.0, above=0, below=math.inf)
    """Weight of squared differences. With 2 their gradient is that of absolute ones at a
    difference of 1/4, so that as many splats grow."""
    hexplane: HexPlaneConfig = field(default_factory=HexPlaneConfig)
    mlp: MlpConfig = field(default_factory=MlpConfig)
    hash: HashConfig = field(default_factory=HashConfig)
    optim: DeformationOptim = field(default_factory=DeformationOptim)

    def step_costs(self) -> tuple[tuple[int, float], ...]:
        """Static steps at first, and then those with the field."""
        return (0, 1.0), (self.coarse_steps, FIELD_COST)

    def build(self) -> Method:
        """Build the method."""
        from gsfw.methods.gaussians4d.method import DeformationMethod

        return DeformationMethod(self)

    def check(self) -> None:
        """Check the values of every run, and this method's own.

        Raises:
            ConfigError: a value is wrong; names the key, the expected and the given value.
        """
        super().check()
        if self.coarse_steps >= self.steps:
            raise ConfigError(
                f"coarse_steps={self.coarse_steps}: expected less than "
                f"steps={self.steps}, so that the field is trained.",
                "Leave it out, so that it follows from steps, or use method=3dgs ignore_time=true.",
            )
        if self.deform_sh and self.sh == "adaptive":
            raise ConfigError(
                "deform_sh=true sh=adaptive: the field changes the same bands of every splat.",
                "Use one of the two.",
            )
        for key, sizes in (("hexplane", self.hexplane), ("hash", self.hash)):
            times, head = sizes.times, sizes.head_width
            if times != "auto" and (times < 0 or times == 1):
                raise ConfigError(
                    f"{key}.times={times}: expected auto, 0, or a number of at least 2."
                )
            if head != "auto" and head < 0:
                raise ConfigError(
                    f"{key}.head_width={head}: expected auto, or a number of at least 0."
                )
        factors = self.hexplane.multipliers
        if not factors or min(factors) < 1:
            raise ConfigError(
                f"hexplane.multipliers={factors}: expected whole numbers of at least 1, "
                "such as 1,2."
            )
        if self.hash.finest < self.hash.coarsest:
            raise ConfigError(
                f"hash.finest={self.hash.finest}: expected at least "
                f"hash.coarsest={self.hash.coarsest}.",
                f"Give hash.coarsest={self.hash.finest} or less, or a larger hash.finest.",
            )
