"""Procedural textures: colours as smooth functions of a solid's own coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

Texture = Callable[[Float[Tensor, "3 n"]], Float[Tensor, "3 n"]]
"""Points of the surface, in the solid's own coordinates -> colours in [0, 1]; both in columns."""

Rgb = tuple[float, float, float]


def _wave(phase: Float[Tensor, " n"], sharpness: float) -> Float[Tensor, " n"]:
    """A square wave in [0, 1] of period 2 pi, whose edges are as soft as a tanh."""
    return 0.5 + 0.5 * torch.tanh(sharpness * phase.sin()) / math.tanh(sharpness)


def _mix(first: Rgb, second: Rgb, weight: Float[Tensor, " n"]) -> Float[Tensor, "3 n"]:
    start, end = _column(first, weight), _column(second, weight)
    return start + (end - start) * weight


def _column(color: Rgb, like: Float[Tensor, "*n"]) -> Float[Tensor, "3 1"]:
    return like.new_tensor(color)[:, None]


@dataclass(frozen=True)
class Waves:
    """Smooth noise in [-1, 1]: a sum of plane waves of random direction and phase."""

    frequencies: Float[Tensor, "k 3"]
    phases: Float[Tensor, "k 1"]

    @staticmethod
    def random(generator: torch.Generator, frequency: float, count: int = 8) -> Waves:
        """Waves of about ``frequency`` radians per unit."""
        directions = torch.randn(count, 3, generator=generator)
        spread = 0.5 + torch.rand(count, 1, generator=generator)
        frequencies = frequency * spread * directions / directions.norm(dim=1, keepdim=True)
        return Waves(frequencies, 2 * math.pi * torch.rand(count, 1, generator=generator))

    def __call__(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        """The noise at points."""
        waves = (self.frequencies.to(points) @ points + self.phases.to(points)).sin()
        return torch.tanh(waves.mean(dim=0) * 2.5)


@dataclass(frozen=True)
class Checker:
    """A soft checker in the xy plane, clouded by noise, with a plain rim."""

    light: Rgb
    dark: Rgb
    rim: Rgb
    cells: float
    """Cells from the centre to the rim."""
    noise: Waves

    def __call__(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Colours of the surface."""
        x, y, _ = points * (math.pi * self.cells)
        weight = 2 * (_wave(x, 2.5) - 0.5) * (_wave(y, 2.5) - 0.5) + 0.5
        cloud = 1 + 0.1 * self.noise(points)
        colors = _mix(self.light, self.dark, weight) * cloud
        radius = points[:2].square().sum(dim=0).sqrt()
        edge = torch.sigmoid((radius - 0.93) * 90)
        return (colors + (_column(self.rim, points) - colors) * edge).clamp(0, 1)


@dataclass(frozen=True)
class Bands:
    """Soft stripes: along z, and winding around it ``turns`` times."""

    first: Rgb
    second: Rgb
    stripes: float
    """Pairs of stripes per unit of z."""
    turns: int = 0
    """Pairs of stripes around the z axis."""
    sharpness: float = 2.5

    def __call__(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Colours of the surface."""
        x, y, z = points
        phase = 2 * math.pi * self.stripes * z + self.turns * torch.atan2(y, x)
        return _mix(self.first, self.second, _wave(phase, self.sharpness))


@dataclass(frozen=True)
class Gradient:
    """One colour at the bottom, another at the top, clouded by noise."""

    bottom: Rgb
    top: Rgb
    noise: Waves
    depth: float = 0.25
    """Weight of the noise that is added to the height."""

    def __call__(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Colours of the surface."""
        height = 0.5 + 0.5 * points[2] + self.depth * self.noise(points)
        return _mix(self.bottom, self.top, height.clamp(0, 1))


@dataclass(frozen=True)
class Marble:
    """Two colours that flow into one another, and a frame along a cube's edges."""

    first: Rgb
    second: Rgb
    edge: Rgb
    noise: Waves

    def __call__(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Colours of the surface."""
        colors = _mix(self.first, self.second, _wave(3.0 * self.noise(points), 1.5))
        # On a cube's face one coordinate is 1; near an edge a second one is close to it.
        x, y, z = points.abs()
        smaller, larger = torch.minimum(x, y), torch.maximum(x, y)
        second_largest = torch.maximum(smaller, torch.minimum(larger, z))
        edge = torch.sigmoid((second_largest - 0.86) * 40)
        return colors + (_column(self.edge, points) - colors) * edge
