"""Motions: where a solid is at a time, as an affine map from its own coordinates to the world."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Float64
from torch import Tensor


@dataclass(frozen=True)
class Pose:
    """world = linear @ own + center, in float64; points and directions are columns."""

    linear: Float64[Tensor, "3 3"]
    center: Float64[Tensor, " 3"]

    @cached_property
    def inverse(self) -> Float64[Tensor, "3 3"]:
        """Inverse of ``linear``."""
        return self.linear.inverse()

    def to_world(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Points of the solid, in the world."""
        return self.linear.to(points) @ points + self.center.to(points)[:, None]

    def corners(self) -> Float64[Tensor, "3 8"]:
        """Corners of a box around the solid, in the world."""
        ends = torch.tensor([-1.0, 1.0], dtype=torch.float64)
        return self.to_world(torch.cartesian_prod(ends, ends, ends).T)

    def to_own(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Points of the world, in the solid's own coordinates."""
        return self.inverse.to(points) @ (points - self.center.to(points)[:, None])

    def directions_to_own(self, directions: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Directions of the world, in the solid's own coordinates."""
        return self.inverse.to(directions) @ directions

    def normals_to_world(self, normals: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Normals of the solid, in the world and of length 1."""
        turned = self.inverse.T.to(normals) @ normals
        return turned / turned.square().sum(dim=0).sqrt()


Motion = Callable[[float], Pose]
"""Time in [0, 1] -> pose; time 0 is the static scene."""


def _vector(x: float, y: float, z: float) -> Float64[Tensor, " 3"]:
    return torch.tensor([x, y, z], dtype=torch.float64)


def _turn(angle: float) -> Float64[Tensor, "3 3"]:
    """Rotation about the z axis, in radians."""
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)


@dataclass(frozen=True)
class Still:
    """Stands where it is."""

    center: tuple[float, float, float]
    size: tuple[float, float, float]
    """Half the extent along its own axes."""
    angle: float = 0.0
    """About the z axis, in radians."""

    def __call__(self, time: float) -> Pose:
        """The same pose at every time."""
        return Pose(_turn(self.angle) @ torch.diag(_vector(*self.size)), _vector(*self.center))


@dataclass(frozen=True)
class Turning:
    """Rotates about its own z axis."""

    start: Still
    sweep: float
    """Radians from time 0 to time 1."""

    def __call__(self, time: float) -> Pose:
        """The start, turned."""
        pose = self.start(time)
        return Pose(_turn(self.sweep * time) @ pose.linear, pose.center)


@dataclass(frozen=True)
class Hopping:
    """Translates along an arc around the world's z axis, and hops on the way."""

    start: Still
    sweep: float
    """Radians of the arc from time 0 to time 1."""
    height: float
    """Height of the hop, reached at time 1/2."""

    def __call__(self, time: float) -> Pose:
        """The start, moved but never turned."""
        pose = self.start(time)
        center = _turn(self.sweep * time) @ pose.center
        center[2] += self.height * math.sin(math.pi * time) ** 2
        return Pose(pose.linear, center)


@dataclass(frozen=True)
class Squashing:
    """Is pressed down and swells, while its top leans over; its foot stays, and its volume."""

    start: Still
    press: float
    """Fraction of the height that is lost at time 1/2."""
    lean: float
    """Sideways shift of the top at time 1, in units of the height."""

    def __call__(self, time: float) -> Pose:
        """The start, deformed."""
        pose = self.start(time)
        height = 1 - self.press * math.sin(math.pi * time) ** 2
        deform = torch.diag(_vector(height**-0.5, height**-0.5, height))
        deform[0, 2] = self.lean * math.sin(0.5 * math.pi * time) * height
        foot = pose.center - _vector(0.0, 0.0, float(pose.linear[2, 2]))
        return Pose(deform @ pose.linear, foot + deform @ (pose.center - foot))
