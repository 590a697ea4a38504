"""Method my-part: Gaussians that move along waves, and turn.

Each Gaussian has a Fourier series of its position, and a polynomial of its quaternion, over the
time; colour, size and opacity stay. Density control, the optimizer, checkpoints and model files
include both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from gsfw.api import (
    Cameras,
    Column,
    LearningRate,
    Method,
    MovingConfig,
    MovingGaussians,
    MovingMethod,
    Operators,
    Scene,
    Splats,
    StaticGaussians,
    StillRows,
    number,
)
from torch import Tensor


@dataclass
class MyPartConfig(MovingConfig):
    """Settings of method my-part, besides those of every moving one."""

    waves: int = number(3, at_least=1, at_most=64)
    """Number of waves of a path; wave k has k half periods in the sequence."""
    turn_degree: int = number(1, at_least=1, at_most=8)
    """Degree of the polynomials of quaternions."""
    paths_lr: float = number(5e-4, at_least=0, at_most=1)
    """Learning rate of paths, times the scene's extent."""
    turns_lr: float = number(1e-3, at_least=0, at_most=1)
    """Learning rate of the coefficients of rotations."""

    def build(self) -> Method:
        """Build the method."""
        return MyPart(self)


class MyPartGaussians(MovingGaussians):
    """Static Gaussians, each with a path and a rotation."""

    def __init__(
        self,
        canonical: StaticGaussians,
        still: StillRows | None,
        config: MyPartConfig,
        extent: float,
    ) -> None:
        super().__init__(canonical, still)
        count = canonical.num_rows
        self.paths = self.temporal_column(
            torch.zeros(count, 2 * config.waves, 3), LearningRate(config.paths_lr * extent)
        )
        self.turns = self.temporal_column(
            torch.zeros(count, config.turn_degree, 4), LearningRate(config.turns_lr)
        )

    def temporal_columns(self) -> Mapping[str, Column]:
        """The columns paths [m, 2 waves, 3] and turns [m, degree, 4]; zeros stand for rest."""
        return {"paths": self.paths, "turns": self.turns}

    def splats(self, time: Tensor | None = None, cameras: Cameras | None = None) -> Splats:
        """The Gaussians at ``time`` in [0, 1]; at 0 for ``None``."""
        still = self.canonical.splats()
        assert still.quats is not None  # By ``StaticGaussians``.
        time = still.means.new_zeros(()) if time is None else time.to(still.means)
        return replace(
            still,
            means=self.moved(still.means, _weighted(self._waves(time), self.paths.values)),
            quats=self.moved(still.quats, _weighted(self._powers(time), self.turns.values)),
        )

    def _waves(self, time: Tensor) -> Tensor:
        """Sines and cosines - 1 at a time, [2 waves]; zero at time 0, where paths begin."""
        count = self.paths.values.shape[1] // 2
        angles = math.pi * time * torch.arange(1, count + 1, device=time.device)
        return torch.cat([angles.sin(), angles.cos() - 1])

    def _powers(self, time: Tensor) -> Tensor:
        """Powers 1 to the degree of a time, [degree]."""
        return time ** torch.arange(1, self.turns.values.shape[1] + 1, device=time.device)


class MyPart(MovingMethod):
    """Losses, the SH degree and the start are those of method 3dgs."""

    def __init__(self, config: MyPartConfig) -> None:
        super().__init__(config, config)
        self.config = config

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> MyPartGaussians:
        """Gaussians at rest, from a file's splats, from the scene's points, or at random."""
        canonical = self.canonical.build_model(scene, operators, generator, initial)
        still = self.still_rows(canonical.num_rows)
        return MyPartGaussians(canonical, still, self.config, scene.extent)


def _weighted(weights: Tensor, coefficients: Tensor) -> Tensor:
    """Sums [m, d] of coefficients [m, k, d], with weights [k]."""
    return (weights[:, None] * coefficients).sum(dim=1)
