"""Made-up colours of points in images, with a known dependence on the view."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gsfw.preparation.check.track_colors import TrackColors

NOISE = 1.5 / 255
"""Standard deviation of every colour."""

Shine = Callable[[np.ndarray, np.ndarray], np.ndarray]


def lobe(points: np.ndarray, cosines: np.ndarray) -> np.ndarray:
    """Degree 1: every other point is brighter towards its side, the others are darker."""
    return 0.15 * (-1.0) ** points * cosines


def highlight(points: np.ndarray, cosines: np.ndarray) -> np.ndarray:
    """A highlight around its side, half as bright at 22 degrees, on every other point."""
    return 0.3 * (points % 2) * np.exp(9 * (cosines - 1))


def observed(
    shine: Shine | None = None, points: int = 240, views: int = 48, noise: float = NOISE
) -> TrackColors:
    """Points around the origin, each seen by the half of the cameras on a dome that it faces.

    Args:
        shine: what is added to the colours, by the number of the point and the cosine of the
            direction with the point's side: the direction it is seen from by some image.
        points: how many.
        views: how many.
        noise: standard deviation of every colour.
    """
    random = np.random.default_rng(5)
    angles = 2 * np.pi * np.arange(views) / views
    heights = random.uniform(0.1, 1.2, views)
    cameras = np.stack([np.cos(angles), np.sin(angles), heights], axis=1)
    normals = random.normal(size=(points, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rays = 0.2 * normals[:, None] - cameras
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    facing = (rays * normals[:, None]).sum(2).argsort(1)[:, : views // 2]
    of_point, of_view = np.repeat(np.arange(points), views // 2), np.sort(facing).reshape(-1)
    directions = rays[of_point, of_view]
    colors = random.uniform(0.25, 0.6, (points, 3))[of_point]
    colors = colors + noise * random.normal(size=colors.shape)
    if shine is not None:
        sides = rays[np.arange(points), facing[:, views // 8]][of_point]
        colors = colors + shine(of_point, (directions * sides).sum(1))[:, None]
    return TrackColors(
        rows=np.arange(points),
        points=of_point,
        views=of_view,
        directions=directions,
        colors=colors,
        misplaced=np.zeros(len(of_point)),
    )


def exposed(colors: TrackColors) -> tuple[TrackColors, np.ndarray, np.ndarray]:
    """The same under gains and offsets of each image, and these, [v, 3]."""
    random = np.random.default_rng(5)
    count = colors.views.max() + 1
    gains = random.uniform(0.8, 1.2, (count, 3))
    offsets = random.uniform(-0.05, 0.05, (count, 3))
    changed = gains[colors.views] * colors.colors + offsets[colors.views]
    return replace(colors, colors=changed), gains, offsets
