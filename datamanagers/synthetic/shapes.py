"""Solids of size 1 in coordinates of their own, which rays meet in closed form.

Points and directions are columns, [3, n]: rays by the million are several times faster so.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch
from jaxtyping import Bool, Float
from torch import Tensor

TINY = 1e-20
"""Stands for a direction component of 0, so that divisions give huge numbers and not NaN."""


class Shape(ABC):
    """A closed solid in its own coordinates, where it fits into the cube from -1 to 1."""

    @abstractmethod
    def distances(
        self, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
    ) -> Float[Tensor, " n"]:
        """Distances along rays from outside to the surface, in lengths of their directions.

        Infinite where they never do. There is an origin for each ray (o is n), or one for all (1).
        """

    @abstractmethod
    def normals(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Outward normals at points of the surface; not normalised."""


class Sphere(Shape):
    """The unit sphere."""

    def distances(
        self, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
    ) -> Float[Tensor, " n"]:
        """The nearer root of |o + t d| = 1."""
        a, b = _dot(directions, directions), _dot(origins, directions)
        root = b.square() - a * (_dot(origins, origins) - 1)
        near = (-b - root.clamp_min(0).sqrt()) / a
        return _where((root >= 0) & (near > 0), near)

    def normals(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """The points themselves."""
        return points


class Box(Shape):
    """The cube from -1 to 1."""

    def distances(
        self, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
    ) -> Float[Tensor, " n"]:
        """The latest entry into a pair of opposite faces, if it is before the first exit."""
        inverse = _safe(directions).reciprocal()
        first, second = (-1 - origins) * inverse, (1 - origins) * inverse
        enter, leave = torch.minimum(first, second), torch.maximum(first, second)
        near = torch.maximum(torch.maximum(enter[0], enter[1]), enter[2])
        far = torch.minimum(torch.minimum(leave[0], leave[1]), leave[2])
        return _where((near <= far) & (near > 0), near)

    def normals(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """The axis of the largest coordinate."""
        x, y, z = points.abs()
        first = (x >= y) & (x >= z)
        second = ~first & (y >= z)
        axes = torch.stack([first, second, ~(first | second)])
        return torch.where(axes, points.sign(), 0.0)


class Cylinder(Shape):
    """Radius 1 around the z axis, closed at z = -1 and z = 1."""

    def distances(
        self, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
    ) -> Float[Tensor, " n"]:
        """The later entry into the infinite cylinder and the slab, if before the first exit."""
        across, along = origins[:2], directions[:2]
        a = _dot(along, along).clamp_min(TINY)
        b = _dot(across, along)
        root = b.square() - a * (_dot(across, across) - 1)
        half = root.clamp_min(0).sqrt()
        inverse = _safe(directions[2]).reciprocal()
        first, second = (-1 - origins[2]) * inverse, (1 - origins[2]) * inverse
        near = torch.maximum((-b - half) / a, torch.minimum(first, second))
        far = torch.minimum((-b + half) / a, torch.maximum(first, second))
        return _where((root >= 0) & (near <= far) & (near > 0), near)

    def normals(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Along z on the caps, away from the axis on the side."""
        x, y, z = points
        zero = torch.zeros_like(z)
        cap = z.abs() >= (x.square() + y.square()).sqrt()
        return torch.stack([torch.where(cap, zero, x), torch.where(cap, zero, y), z * cap])


class Cone(Shape):
    """Apex at z = 1 on the z axis, base of radius 1 at z = -1."""

    def distances(
        self, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
    ) -> Float[Tensor, " n"]:
        """The least of both roots of |xy| = (1 - z) / 2 between base and apex, and the base."""
        x, y, z = origins
        u, v, w = directions
        radius, change = (1 - z) / 2, -w / 2
        a = u * u + v * v - change * change
        b = x * u + y * v - radius * change
        root = b.square() - a * (x * x + y * y - radius * radius)
        # One root as q / a and the other as c / q: none loses digits where a is near 0.
        q = -(b + torch.where(b >= 0, 1.0, -1.0) * root.clamp_min(0).sqrt())
        nearest = torch.full_like(w, math.inf)
        for t in (q / _safe(a), (x * x + y * y - radius * radius) / _safe(q)):
            inside = (z + t * w).abs() <= 1
            nearest = torch.minimum(nearest, _where((root >= 0) & inside & (t > 0), t))
        base = (-1 - z) / _safe(w)
        inside = (x + base * u).square() + (y + base * v).square() <= 1
        return torch.minimum(nearest, _where(inside & (base > 0), base))

    def normals(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Downwards on the base; outwards and a little upwards on the side."""
        x, y, z = points
        radius = (x.square() + y.square()).sqrt()
        base = (z + 1) < (radius - (1 - z) / 2).abs()
        zero = torch.zeros_like(z)
        up = torch.where(base, -1.0, radius / 2)
        return torch.stack([torch.where(base, zero, x), torch.where(base, zero, y), up])


def _dot(first: Float[Tensor, "d o"], second: Float[Tensor, "d n"]) -> Float[Tensor, " p"]:
    # torch's sum over a first dimension of 2 or 3 is several times slower.
    x, y, *rest = (a * b for a, b in zip(first, second, strict=True))
    return sum(rest, start=x + y)


def _safe(divisor: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    return torch.where(divisor.abs() < TINY, TINY, divisor)


def _where(met: Bool[Tensor, " n"], distance: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    return torch.where(met, distance, math.inf)
