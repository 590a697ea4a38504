"""Stage: the solids of the built-in scene, and what rays see of them at a time.

Points, directions and colours are columns, [3, n].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Int
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
    """One thing in the scene."""

    name: str
    shape: Shape
    motion: Motion
    texture: Texture
    gloss: float = 0.0
    """Strength of the highlight."""
    present: tuple[float, float] = (0.0, 1.0)
    """First and last time at which it is there."""

    def is_present(self, time: float) -> bool:
        """Whether it is there at a time."""
        return self.present[0] <= time <= self.present[1]

    @property
    def changes(self) -> bool:
        """Whether it ever moves, deforms, appears or vanishes."""
        return not isinstance(self.motion, Still) or self.present != (0.0, 1.0)


def solids(seed: int) -> tuple[Solid, ...]:
    """The scene: a disc at z = 0, and what stands on it; ``seed`` draws the noise of textures."""
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
    """What ``n`` rays meet first."""

    solid: Int[Tensor, " n"]
    """Index among all solids; -1 where a ray meets nothing."""
    points: Float[Tensor, "3 n"]
    """In the world; arbitrary where nothing is met."""


@dataclass(frozen=True)
class Stage:
    """The solids as they are at one time."""

    solids: tuple[Solid, ...]
    time: float

    @cached_property
    def placed(self) -> list[tuple[int, Solid, Pose]]:
        """Those that are there, with their index and pose."""
        return [
            (index, solid, solid.motion(self.time))
            for index, solid in enumerate(self.solids)
            if solid.is_present(self.time)
        ]

    def trace(self, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]) -> Hits:
        """What rays from outside all solids meet first; all may share one origin, [3, 1]."""
        nearest = torch.full_like(directions[0], math.inf)
        solid = torch.full_like(nearest, -1, dtype=torch.int64)
        for index, item, pose in self.placed:
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
        sun = hits.points.new_tensor(LIGHT)[:, None]
        for index, item, pose in self.placed:
            chosen = (hits.solid == index).nonzero()[:, 0]
            points = hits.points[:, chosen]
            own = pose.to_own(points)
            normals = pose.normals_to_world(item.shape.normals(own))
            facing = (normals * sun).sum(dim=0).clamp_min(0)
            sunlit = facing * ~self._in_shadow(points + LIFT * normals, facing)
            sky = AMBIENT * (0.85 + 0.15 * normals[2])
            shaded = item.texture(own) * (sky + DIFFUSE * sunlit)
            if item.gloss > 0:
                ahead = directions[:, chosen]
                halfway = _unit(sun - _unit(ahead))
                mirrored = (normals * halfway).sum(dim=0).clamp_min(0) ** SHININESS
                shaded = shaded + item.gloss * mirrored * (sunlit > 0)
            colors[:, chosen] = shaded.clamp(0, 1)
        return colors

    def _in_shadow(
        self, points: Float[Tensor, "3 n"], facing: Float[Tensor, " n"]
    ) -> Bool[Tensor, " n"]:
        """Whether something stands between points and the sun."""
        sun = points.new_tensor(LIGHT)[:, None].expand_as(points)
        dark = facing <= 0
        for _, item, pose in self.placed:
            dark = dark | _distances(item, pose, points, sun).isfinite()
        return dark


def _unit(vectors: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
    return vectors / vectors.square().sum(dim=0).sqrt()


def _distances(
    item: Solid, pose: Pose, origins: Float[Tensor, "3 o"], directions: Float[Tensor, "3 n"]
) -> Float[Tensor, " n"]:
    return item.shape.distances(pose.to_own(origins), pose.directions_to_own(directions))
