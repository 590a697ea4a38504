"""Settings of method 4dgs; the defaults are those of Wu et al. 2024 for synthetic scenes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.core.config import steps_field
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.methods.gaussians3d.config import StaticGaussiansOptim
from gsfw.methods.moving.config import MovingConfig

if TYPE_CHECKING:
    from gsfw.core.method import Method

MAX_LOG2_ROWS = 24
"""Rows of a hash table are counted by 32-bit numbers; Mueller et al. 2022 go up to 2^24."""
COUNTS = (
    *("hexplane.channels", "hexplane.width", "hexplane.depth", "mlp.width", "mlp.depth"),
    *("hash.levels", "hash.features", "hash.coarsest", "hash.width", "hash.depth"),
)
"""Settings of which there is at least one."""


@dataclass
class DeformationOptim(StaticGaussiansOptim):
    """Learning rates of the canonical Gaussians and of the field.

    Those of the field do not follow the scene's extent, because the field does not: the paper's
    are multiplied by the extent, which is about 5 for its synthetic scenes, and so are these. They
    fall to a tenth, as the paper's do for captured scenes, and not to a hundredth: short runs lose
    3 dB by that.
    """

    grid_lr: float = 8e-3
    """Rate of planes or tables at the first fine step."""
    grid_lr_final: float = 8e-4
    """Rate of planes or tables once it has decayed, log-linearly."""
    network_lr: float = 8e-4
    """Rate of the networks at the first fine step."""
    network_lr_final: float = 8e-5
    """Rate of the networks once it has decayed, log-linearly."""
    field_lr_steps: int = steps_field(20_000)
    """Fine steps over which the rates of planes, tables and networks decay."""

    def field_rates(self, start: int) -> dict[str, LearningRate]:
        """The rates of the field, zero before the step ``start``."""
        steps = self.field_lr_steps
        return {
            "grid": LearningRate(self.grid_lr, self.grid_lr_final, steps, start),
            "network": LearningRate(self.network_lr, self.network_lr_final, steps, start),
        }


@dataclass
class HexPlaneConfig:
    """Sizes of the planes, and weights of their regularisers."""

    channels: int = 32
    """Features per cell."""
    resolution: int = 64
    """Cells along x, y and z, at the coarsest resolution."""
    multipliers: tuple[int, ...] = (1, 2)
    """The resolutions, as multiples of the coarsest; time has the same cells at all."""
    times: int = 0
    """Cells along time; 0: as many as distinct times were captured, at most 100."""
    width: int = 64
    """Width of the network's layers."""
    depth: int = 1
    """Layers between the planes and those of each quantity."""
    plane_tv: float = 1e-4
    """Weight of the total variation of space planes; 0: none."""
    time_smoothness: float = 1e-2
    """Weight of squared second differences of time planes along time; 0: none."""
    time_l1: float = 1e-4
    """Weight of the distance of time planes from 1, which is no motion; 0: none."""


@dataclass
class MlpConfig:
    """Sizes of the network (Yang et al. 2024)."""

    width: int = 256
    """Width of the layers."""
    depth: int = 8
    """Number of layers; the input is joined again in the middle."""
    frequencies: int = 10
    """Frequencies of each coordinate, each twice the one before."""
    time_frequencies: int = 6
    """Frequencies of time, each twice the one before."""


@dataclass
class HashConfig:
    """Sizes of the tables (Mueller et al. 2022)."""

    levels: int = 8
    """Number of resolutions."""
    features: int = 4
    """Features per row of a table; their product with levels is what the network is given."""
    log2_rows: int = 15
    """Logarithm to base 2 of the largest number of rows of a table."""
    coarsest: int = 8
    """Cells along an axis at the coarsest resolution."""
    finest: int = 128
    """Cells along an axis at the finest resolution."""
    times: int = 0
    """Most cells along time; 0: as many as distinct times were captured, at most 100."""
    width: int = 64
    """Width of the network's layers."""
    depth: int = 1
    """Layers between the tables and those of each quantity."""


@dataclass
class DeformationConfig(MovingConfig):
    """Canonical Gaussians and a deformation field (Wu et al. 2024; Yang et al. 2024)."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {"strategy.reset_every": 0, "strategy.max_gaussians": 360_000},
        "fast": {
            "steps": 7_000,
            "sh_degree": 2,
            "hexplane.channels": 16,
        },
        "mlp": {
            "encoder": "mlp",
            "ssim_weight": 0.2,
            "strategy.grow_gradient": 7e-4,
        },
    }
    """default: Wu et al. 2024, with the released code's limit on the number of splats, and without
    opacity resets, which hurt scenes that move; fast: a third of the steps, half the features; mlp:
    Yang et al. 2024, whose network is slow on a CPU."""

    steps: int = 23_000
    """Training steps. Schedules follow in proportion, unless rescale=false."""
    encoder: Literal["hexplane", "mlp", "hash"] = "hexplane"
    """What the field is made of: planes, a network alone, or hash tables."""
    coarse_steps: int = steps_field(3000)
    """Steps for which Gaussians are trained as if nothing moved, before the field comes in."""
    deform_opacity: bool = False
    """Whether opacities change with time (for things that appear and vanish)."""
    deform_sh: bool = False
    """Whether colours change with time."""
    ssim_weight: float = 0.0
    """Weight of 1 - SSIM in the loss; the mean absolute difference has the rest."""
    hexplane: HexPlaneConfig = field(default_factory=HexPlaneConfig)
    mlp: MlpConfig = field(default_factory=MlpConfig)
    hash: HashConfig = field(default_factory=HashConfig)
    optim: DeformationOptim = field(default_factory=DeformationOptim)

    def build(self) -> Method:
        """The method."""
        from gsfw.methods.gaussians4d.method import DeformationMethod

        return DeformationMethod(self)

    def check(self) -> None:
        """Check the values every run has, and this method's own.

        Raises:
            ConfigError: naming the key, what was expected, and what was given.
        """
        super().check()
        if not 0 <= self.coarse_steps < self.steps:
            raise ConfigError(
                f"coarse_steps={self.coarse_steps}: expected at least 0 and less than "
                f"steps={self.steps}, so that the field is trained.",
                "Leave it out to have it follow from steps, or use method=3dgs ignore_time=true.",
            )
        if self.deform_sh and self.sh == "adaptive":
            raise ConfigError(
                "deform_sh=true sh=adaptive: the field changes the same bands of every splat.",
                "Use one of the two.",
            )
        self.expect(self._expectations())

    def _expectations(self) -> dict[str, tuple[bool, str]]:
        """What is expected of the encoders' settings, by dotted key."""
        least = dict.fromkeys(COUNTS, 1) | {"hexplane.resolution": 2}
        least |= dict.fromkeys(("mlp.frequencies", "mlp.time_frequencies"), 0)
        expected = {
            key: (attrgetter(key)(self) >= minimum, f"a whole number of at least {minimum}")
            for key, minimum in least.items()
        }
        for key in ("hexplane.plane_tv", "hexplane.time_smoothness", "hexplane.time_l1"):
            fits = 0 <= attrgetter(key)(self) < math.inf
            expected[key] = (fits, "a finite number of at least 0")
        for key in ("hexplane.times", "hash.times"):
            fits = attrgetter(key)(self) == 0 or attrgetter(key)(self) >= 2
            expected[key] = (fits, "0, or a whole number of at least 2")
        factors, tables = self.hexplane.multipliers, self.hash
        return {
            **expected,
            "hexplane.multipliers": (
                len(factors) > 0 and min(factors) >= 1,
                "whole numbers of at least 1, such as 1,2",
            ),
            "hash.log2_rows": (
                1 <= tables.log2_rows <= MAX_LOG2_ROWS,
                f"a whole number from 1 to {MAX_LOG2_ROWS}",
            ),
            "hash.finest": (
                tables.finest >= tables.coarsest,
                f"a whole number of at least hash.coarsest={tables.coarsest}",
            ),
        }
