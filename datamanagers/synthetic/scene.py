"""SyntheticScene: the solids of the built-in scene, traced and shaded at one time.

Points, directions and colours are columns, [3, n].
"""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from gsfw.datamanagers.synthetic.motion import Hopping, Motion, Pose, Squashing, Still, Turning
from gsfw.datamanagers.synthetic.shapes import Box, Cone, Cylinder, Shape, Sphere
from gsfw.datamanagers.synthetic.textures import Bands, Checker, Gradient, Marble, Texture, Waves

LIGHT = (-0.42, -0.36, 0.83)
"""Direction to the sun, in the world; of length 1 within rounding."""
AMBIENT = 0.5
"""Light from everywhere, which also reaches shadows."""
DIFFUSE = 0.6
"""Light of the sun on a surface that faces it."""
SHININESS = 24.0
"""Exponent of the highlight (Blinn 1977): low, so that spherical harmonics can follow it."""
LIFT = 1e-3
"""Shadow rays start this far above their surface, in world units, so as not to meet it."""


@dataclass(frozen=True)
class Solid:
    """An object of the scene."""

    name: str
    shape: Shape
    motion: Motion
    texture: Texture
    gloss: float = 0.0
    """Strength of the highlight."""
    present: tuple[float, float] = (0.0, 1.0)
    """First and last time at which it is there."""

    def is_present(self, time: float) -> bool:
        """True if the solid is present at a time."""
        return self.present[0] <= time <= self.present[1]

    @property
    def changes(self) -> bool:
        """True if the solid ever moves, deforms, appears or vanishes."""
        return not isinstance(self.motion, Still) or self.present != (0.0, 1.0)


def solids(seed: int) -> tuple[Solid, ...]:
    """The solids: a disc at z = 0, and those on it; ``seed`` draws the noise of textures."""
    generator = torch.Generator().manual_seed(seed)

    def noise(frequency: float) -> Waves:
        return Waves.random(generator, frequency)

    cream, ink = (0.93, 0.88, 0.78), (0.33, 0.45, 0.55)
    table = Checker(cream, ink, (0.46, 0.30, 0.21), 3.5, noise(9.0))
    column = Bands((0.95, 0.93, 0.88), (0.77, 0.24, 0.19), 0.75, turns=2)
    crate = Marble((0.12, 0.42, 0.44), (0.55, 0.80, 0.66), (0.92, 0.78, 0.42), noise(2.6))
    ball = Bands((0.97, 0.76, 0.20), (0.85, 0.40, 0.10), 0.9)
    drop = Gradient((0.36, 0.20, 0.52), (0.93, 0.55, 0.66), noise(3.5))
    cone = Bands((0.30, 0.58, 0.28), (0.80, 0.88, 0.52), 1.0)
    pebble = Gradient((0.25, 0.27, 0.30), (0.72, 0.74, 0.76), noise(4.0))
    return (
        Solid("table", Cylinder(), Still((0.0, 0.0, -0.05), (1.5, 1.5, 0.05)), table),
        Solid("column", Cylinder(), Still((-0.05, 0.15, 0.52), (0.2, 0.2, 0.52)), column),
        Solid("crate", Box(), Turning(Still((-0.72, -0.2, 0.3), (0.3, 0.3, 0.3), 0.4), 2.1), crate),
        Solid(
            "ball",
            Sphere(),
            Hopping(Still((0.72, 0.48, 0.33), (0.33, 0.33, 0.33)), 1.4, 0.35),
            ball,
            gloss=0.35,
        ),
        Solid(
            "drop",
            Sphere(),
            Squashing(Still((0.35, -0.55, 0.38), (0.27, 0.27, 0.38)), 0.4, 0.45),
            drop,
            gloss=0.15,
        ),
        Solid(
            "pebble",
            Sphere(),
            Still((-0.25, 1.0, 0.13), (0.2, 0.16, 0.13), 0.7),
            pebble,
            present=(0.0, 0.6),
        ),
        Solid(
            "cone", Cone(), Still((-0.2, -0.95, 0.28), (0.2, 0.2, 0.28)), cone, present=(0.4, 1.0)
        ),
    )


@dataclass(frozen=True)
class Hits:
    """First hits of ``n`` rays."""

    solid: Int[Tensor, " n"]
    """Index among all solids; -1 where a ray meets nothing."""
    points: Float[Tensor, "3 n"]
    """In the world; arbitrary where nothing is met."""


@dataclass(frozen=True)
class SyntheticScene:
    """The solids as they are at one time."""

    solids: tuple[Solid, ...]
    time: float

    @cached_property
    def placed(self) -> list[tuple[int, Solid, Pose]]:
        """The solids that are present at the time, each with its index and pose."""
        return [
            (index, solid, solid.motion(self.time))
            for index, solid in enumerate(self.solids)
            if solid.is_present(self.time)
        ]

    @cached_property
    def _sunward(self) -> list[tuple[Float64[Tensor, " 3"], Float64[Tensor, " 3"]]]:
        """Lowest and highest coordinates of each placed solid along ``SUN_AXES``."""
        boxes = [SUN_AXES @ pose.corners() for _, _, pose in self.placed]
        return [(box.amin(dim=1), box.amax(dim=1)) for box in boxes]

    def trace(
        self,
        origins: Float[Tensor, "3 o"],
        directions: Float[Tensor, "3 n"],
        among: Container[int] | None = None,
    ) -> Hits:
        """The first hit of each ray.

        Args:
            origins: outside all solids, one for each ray or one for all (o is 1).
            directions: of any length.
            among: indices of the solids that the rays can meet; ``None`` for all.
        """
        nearest = torch.full_like(directions[0], math.inf)
        solid = torch.full_like(nearest, -1, dtype=torch.int64)
        for index, item, pose in self.placed:
            if among is not None and index not in among:
                continue
            distances = _distances(item, pose, origins, directions)
            nearer = distances < nearest
            nearest = torch.where(nearer, distances, nearest)
            solid = torch.where(nearer, index, solid)
        reach = torch.where(solid >= 0, nearest, 0.0)
        return Hits(solid, origins + reach * directions)

    def shade(self, hits: Hits, directions: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Colours in [0, 1] that arrive along rays; 0 where they meet nothing.

        Lambert's law with the sun's hard shadow, light from everywhere, and Blinn's highlight.
        """
        colors = torch.zeros_like(hits.points)
        for index, item, pose in self.placed:
            chosen = (hits.solid == index).nonzero()[:, 0]
            if len(chosen) == hits.points.shape[1]:
                return self._shade_solid(index, item, pose, hits.points, directions)
            if len(chosen):
                points = hits.points.index_select(1, chosen)
                ahead = directions.index_select(1, chosen)
                shaded = self._shade_solid(index, item, pose, points, ahead)
                for row, values in zip(colors, shaded, strict=True):
                    row[chosen] = values
        return colors

    def _shade_solid(
        self,
        index: int,
        item: Solid,
        pose: Pose,
        points: Float[Tensor, "3 n"],
        directions: Float[Tensor, "3 n"],
    ) -> Float[Tensor, "3 n"]:
        """Colours of points on one solid's surface."""
        sun = points.new_tensor(LIGHT)[:, None]
        own = pose.to_own(points)
        normals = pose.normals_to_world(item.shape.normals(own))
        facing = (normals * sun).sum(dim=0).clamp_min(0)
        sunlit = facing * ~self._in_shadow(index, points + LIFT * normals, facing)
        sky = AMBIENT * (0.85 + 0.15 * normals[2])
        shaded = item.texture(own) * (sky + DIFFUSE * sunlit)
        if item.gloss > 0:
            halfway = _unit(sun - _unit(directions))
            mirrored = (normals * halfway).sum(dim=0).clamp_min(0) ** SHININESS
            shaded = shaded + item.gloss * mirrored * (sunlit > 0)
        return shaded.clamp(0, 1)

    def _in_shadow(
        self, own: int, points: Float[Tensor, "3 n"], facing: Float[Tensor, " n"]
    ) -> Bool[Tensor, " n"]:
        """True if something stands between points and the sun.

        A convex solid (all are) casts no shadow on its own sunny side, so ``own`` is not tried;
        nor are solids whose box, seen from the sun, does not overlap that of the points.
        """
        dark = facing <= 0
        if bool(dark.all()):
            return dark
        sun = points.new_tensor(LIGHT)[:, None].expand_as(points)
        seen = SUN_AXES @ _box(points)
        low, high = seen.amin(dim=1) - LIFT, seen.amax(dim=1) + LIFT
        for (index, item, pose), (start, end) in zip(self.placed, self._sunward, strict=True):
            # Towards the sun, a solid must not end before the points; across, both must overlap.
            apart = bool((end < low).any()) or bool((start > high)[1:].any())
            if index != own and not apart:
                dark = dark | (_distances(item, pose, points, sun) < math.inf)
        return dark


def _box(points: Float[Tensor, "3 n"]) -> Float64[Tensor, "3 8"]:
    """Corners of the box around points, along the axes of the world."""
    ends = torch.stack([points.amin(dim=1), points.amax(dim=1)], dim=1).double()
    return torch.cartesian_prod(*ends).T


def _sun_axes() -> Float64[Tensor, "3 3"]:
    light = torch.tensor(LIGHT, dtype=torch.float64)
    across = torch.linalg.cross(light, torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))
    return torch.stack([light, across, torch.linalg.cross(light, across)])


SUN_AXES = _sun_axes()
"""Directions to the sun and across it, in rows."""


def _unit(vectors: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
    return vectors / vectors.square().sum(dim=0).sqrt()


def _distances(
    item: Solid, pose: Pose, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
) -> Float[Tensor, " n"]:
    return item.shape.distances(pose.to_own(origins), pose.directions_to_own(directions))
