"""Surface: what the cameras of a capture look at, and at which angles they see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from gsfw.core.scene import Scene
from gsfw.methods.gaussians3d.initialisation import OBJECT_SIZE, focus
from gsfw.preparation.check.viewpoints import Viewpoints

POINTS = 2000
"""So many points, spread evenly over those there are, are projected into every place."""
ANGLE_POINTS, ANGLE_PLACES = 300, 200
"""Angles are computed at so many points between so many places: every point takes all pairs."""
OVERLAP = 0.2
"""Views are neighbours if they share this part of what one of them sees: with less, hardly any
part of a picture is constrained by the other."""


@dataclass(frozen=True)
class Surface:
    """Points that are seen, and by which places (different poses) of the cameras."""

    points: Float[np.ndarray, "p 3"]
    rows: Int[np.ndarray, " p"]
    """Their numbers among the points of the scene; -1 for stand-ins."""
    measured: bool
    """False: there are no points, and these stand in for them around where all cameras look."""
    seen: Bool[np.ndarray, "s p"]
    """Which of them are in the picture of each place."""

    @staticmethod
    def of(scene: Scene, viewpoints: Viewpoints) -> Surface | None:
        """Of a scene; ``None`` if it has no points and its cameras look at no one point."""
        points = scene.points.double().numpy()
        finite = np.flatnonzero(np.isfinite(points).all(1))
        rows = finite[np.linspace(0, len(finite) - 1, min(POINTS, len(finite))).astype(int)]
        measured = len(rows) > 0
        if measured:
            points = points[rows]
        else:
            around = focus(scene)
            if around is None:
                return None
            offsets = np.random.default_rng(0).uniform(-1, 1, (ANGLE_POINTS, 3))
            points = around[0].double().numpy() + OBJECT_SIZE * around[1] * offsets
            rows = np.full(len(points), -1)
        seen = np.stack(
            [viewpoints.project(place, points)[1] for place in viewpoints.places.tolist()]
        )
        return Surface(points, rows, measured, seen)


@dataclass(frozen=True)
class Angles:
    """Angles, in degrees, at which views see the same points."""

    nearest: Float[np.ndarray, " s"]
    """From each place to the trained place nearest in angle that shows the same; NaN without."""
    widest: float
    """Median over points of the largest angle between trained places that see it; 0 without."""
    places: tuple[int, ...]
    """Views that the rows of ``nearest`` are."""

    @staticmethod
    def of(surface: Surface, viewpoints: Viewpoints) -> Angles:
        """Between all places, or as many spread evenly."""
        count = len(viewpoints.places)
        chosen = np.unique(np.linspace(0, count - 1, min(count, ANGLE_PLACES)).astype(int))
        places = viewpoints.places[chosen]
        trained = viewpoints.trained[places]
        number = len(surface.points)
        points = np.linspace(0, number - 1, min(number, ANGLE_POINTS)).astype(int)
        total = np.zeros((len(places), len(places)))
        shared = np.zeros_like(total)
        widest: list[float] = []
        for point in points:
            rays = surface.points[point] - viewpoints.centers[places]
            rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
            angles = np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1)))
            seen = surface.seen[chosen, point]
            both = seen[:, None] & seen
            total += np.where(both, angles, 0)
            shared += both
            used = seen & trained
            if used.sum() > 1:
                widest.append(float(angles[np.ix_(used, used)].max()))
        own = np.maximum(np.diag(shared), 1)
        near = (shared >= OVERLAP * own[:, None]) & (shared > 0) & trained
        np.fill_diagonal(near, False)
        mean = np.where(near, total / np.maximum(shared, 1), np.inf).min(1, initial=np.inf)
        nearest = np.where(np.isfinite(mean), mean, np.nan)
        return Angles(nearest, float(np.median(widest)) if widest else 0.0, tuple(places.tolist()))
