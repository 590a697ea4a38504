"""Trails: the paths of some Gaussians over the last frames, drawn on the images of a film."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature
from gsfw.core.loop.evaluation import render_model
from gsfw.core.maths.lens import project_points
from gsfw.core.model import PrimitiveModel
from gsfw.core.numerics import DEFAULT, NEAR
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.temporal_metrics.tracks import OPAQUE, Tracks, follow

if TYPE_CHECKING:
    from gsfw.plugins.compose import Composition

MOTION_WEIGHT = 2.0
"""Rows are well spread when they are apart, or move apart: how much more the second counts."""
TOLERANCE = 0.03
"""Points behind the surface by less than this part of its depth lie on the surface."""
HALF_WIDTH = 0.8
"""Half of the width of the lines, in pixels."""
MOST_CANDIDATES = 50_000
"""Rows to choose among, at equal steps; more would cost time and change little."""


class Trails:
    """Lines behind well-spread rows on the surface, each in a colour of its own, fading with age.

    Of a row that is not there or not opaque nothing is seen, and nothing where a surface hides it.
    """

    def __init__(self, tracks: Tracks, length: int, home: Float[Tensor, "r 3"]) -> None:
        """Trails of rows.

        Args:
            tracks: of these rows, at the time of every frame.
            length: frames that a trail reaches back.
            home: where each row is known from, which gives it its colour.
        """
        self._length = length
        self._positions = tracks.positions
        self._strength = (tracks.opacities >= OPAQUE).cpu().numpy()
        self._colors = _rainbow(home)

    def __len__(self) -> int:
        """Number of trails; 0 where no row on a surface is opaque."""
        return len(self._colors)

    def draw_on(
        self,
        image: Float[Tensor, "h w 3"],
        depth: Float[Tensor, "h w 1"] | None,
        camera: Cameras,
        frame: int | float,
    ) -> Float[Tensor, "h w 3"]:
        """The image of a frame with the trails that lead there.

        Args:
            image: the rendered image.
            depth: of its surface, 0 where there is none; ``None`` when nothing hides trails.
            camera: that of the frame.
            frame: its number; between two of them, trails end between their places.
        """
        last = min(math.floor(frame), len(self._positions) - 1)
        first = max(last - self._length, 0)
        positions, strength = self._positions[first : last + 1], self._strength[first : last + 1]
        ages = np.arange(last - first, -1, -1) / max(self._length, 1)
        if frame > last and last + 1 < len(self._positions):
            head = torch.lerp(positions[-1], self._positions[last + 1], frame - last)
            positions = torch.cat([positions, head[None]])
            strength = np.concatenate([strength, strength[-1:] & self._strength[last + 1]])
            ages = np.append((ages + (frame - last) / max(self._length, 1)).clip(0, 1), 0.0)
        pixels, depths = _project(positions, camera)
        there = strength & np.isfinite(depths)
        canvas = image.clamp(0, 1).cpu().numpy().copy()
        surface = None if depth is None else depth[..., 0].cpu().numpy()
        for row, color in enumerate(self._colors):
            if there[-1, row]:
                line = np.concatenate([pixels[:, row], depths[:, row, None]], axis=1)
                _draw_line(canvas, surface, line, there[:, row], 1.0 - ages, color)
        return torch.from_numpy(canvas)


def make_trails(
    model: PrimitiveModel,
    rasterizer: Rasterizer,
    cameras: Cameras,
    settings: RenderSettings,
    count: int,
    length: int,
) -> Trails:
    """Trails of ``count`` rows that a film's first, middle or last frame shows, or fewer."""
    assert cameras.time is not None
    times = cameras.time.tolist()
    last = len(times) - 1
    frames = sorted({0, last // 2, last})
    sample = follow(model, [times[frame] for frame in frames])
    seen = torch.zeros_like(sample.present[0])
    with_depth = surface_settings(rasterizer, settings)
    for place, frame in enumerate(frames):
        camera = cameras.select([frame])
        output = render_model(model, rasterizer, camera, with_depth, camera.time[0])  # type: ignore[index]
        depth = None if output.depth is None else output.depth[0]
        opaque = sample.opacities[place] >= OPAQUE
        seen |= opaque & _on_surface(sample.positions[place], camera, depth)
    candidates = seen.nonzero()[:, 0]
    candidates = candidates[:: len(candidates) // MOST_CANDIDATES + 1]
    home = _first_places(sample.positions[:, candidates])
    shifts = (sample.positions[:, candidates] - home).nan_to_num()
    places = torch.cat([home, MOTION_WEIGHT * shifts.transpose(0, 1).flatten(1)], dim=1)
    chosen = spread(places, count)
    return Trails(follow(model, times, candidates[chosen]), length, home[chosen])


def trails_along(
    cameras: Cameras, composition: Composition, count: int, length: int
) -> Trails | None:
    """Trails for the frames of a film; ``None`` where all of them show one time.

    Args:
        cameras: one per frame.
        composition: the run.
        count: largest number of trails.
        length: number of frames that each reaches back.
    """
    if cameras.time is None or len(cameras.time.unique()) < 2:
        return None
    parts, settings = composition.parts, composition.plan.settings
    cameras = cameras.to(parts.device)
    return make_trails(parts.model, parts.rasterizer, cameras, settings, count, length)


def surface_settings(rasterizer: Rasterizer, settings: RenderSettings) -> RenderSettings:
    """Settings that render the depth of the surface too, where the rasterizer can."""
    able = Feature.DEPTH in rasterizer.capabilities().features
    return replace(settings, depth=Depth.EXPECTED) if able else settings


def spread(places: Float[Tensor, "n d"], count: int) -> Int[Tensor, " r"]:
    """Up to ``count`` places that are far from one another.

    The first is the one nearest to the mean, each further one the farthest from those before
    (Gonzalez 1985), so that the same places give the same choice.
    """
    if len(places) <= count:
        return torch.arange(len(places), device=places.device)
    chosen = [(places - places.mean(0)).square().sum(1).argmin()]
    distances = torch.full_like(places[:, 0], torch.inf)
    while len(chosen) < count:
        distances = distances.minimum((places - places[chosen[-1]]).square().sum(1))
        chosen.append(distances.argmax())
    return torch.stack(chosen)


def _first_places(positions: Float[Tensor, "t n 3"]) -> Float[Tensor, "n 3"]:
    """Position of each row at the first time that it is there."""
    first = positions.isfinite().all(2).int().argmax(0)
    return positions[first, torch.arange(len(first), device=first.device)]


def _on_surface(
    points: Float[Tensor, "n 3"], camera: Cameras, depth: Float[Tensor, "h w 1"] | None
) -> Tensor:
    """True for points that a camera sees: within its image, and not behind what it shows there."""
    pixels, depths = _project(points[None], camera)
    x, y = np.floor(np.nan_to_num(pixels[0], nan=-1.0, posinf=-1.0, neginf=-1.0)).T
    inside = np.isfinite(depths[0]) & (x >= 0) & (x < camera.width)
    inside &= (y >= 0) & (y < camera.height)
    if depth is not None:
        rows, columns = (np.where(inside, side, 0).astype(np.int64) for side in (y, x))
        surface = depth[..., 0].cpu().numpy()[rows, columns]
        inside &= (surface > 0) & (depths[0] <= surface * (1 + TOLERANCE))
    return torch.from_numpy(inside).to(points.device)


def _project(positions: Float[Tensor, "t n 3"], camera: Cameras) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [t, n, 2] and depths [t, n] of points; NaN behind the camera."""
    pose = camera.world_to_camera[0]
    points = (positions @ pose[:3, :3].T + pose[:3, 3]).reshape(-1, 3)
    points = torch.where(points[:, 2:] > NEAR, points, torch.nan)
    pixels, _ = project_points(points, camera, DEFAULT.jacobian_margin)
    shape = positions.shape[:2]
    return pixels.view(*shape, 2).cpu().numpy(), points[:, 2].view(shape).cpu().numpy()


def _draw_line(
    canvas: np.ndarray,
    surface: np.ndarray | None,
    line: np.ndarray,
    there: np.ndarray,
    strengths: np.ndarray,
    color: Sequence[float],
) -> None:
    """Blend one trail in: [t, 3] pixels and depths, the newest last.

    Every pixel takes the strongest of the segments that cover it, so that joints do not show.
    """
    whole = there[1:] & there[:-1]
    starts, ends, fade = line[:-1][whole], line[1:][whole], strengths[1:][whole]
    starts, ends = np.concatenate([starts, line[-1:]]), np.concatenate([ends, line[-1:]])
    fade = np.append(fade, 1.0)
    height, width = canvas.shape[:2]
    both = np.concatenate([starts, ends])[:, :2]
    low = np.maximum(np.floor(both.min(0) - 2), 0).astype(int)
    high = np.minimum(np.ceil(both.max(0) + 2), (width, height)).astype(int)
    if (low >= high).any():
        return
    box = (slice(low[1], high[1]), slice(low[0], high[0]))
    x, y = np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1])[:, None] + 0.5
    ax, ay, az = (part[:, None, None] for part in starts.T)
    dx, dy, dz = (part[:, None, None] for part in (ends - starts).T)
    along = ((x - ax) * dx + (y - ay) * dy) / np.maximum(dx * dx + dy * dy, 1e-9)
    along = along.clip(0, 1)
    distance = np.hypot(x - ax - along * dx, y - ay - along * dy)
    alpha = (HALF_WIDTH + 0.5 - distance).clip(0, 1) * fade[:, None, None]
    if surface is not None:
        behind = az + along * dz > surface[box] * (1 + TOLERANCE)
        alpha = np.where(behind & (surface[box] > 0), 0.0, alpha)
    strongest = alpha.max(0)[..., None]
    canvas[box] = (1 - strongest) * canvas[box] + strongest * np.asarray(color)


def _rainbow(home: Float[Tensor, "r 3"]) -> list[tuple[float, float, float]]:
    """Bright colours, in order along the axis that rows are spread along the most."""
    if len(home) < 2:
        return [colorsys.hsv_to_rgb(0.0, 0.9, 1.0)] * len(home)
    spreading = home - home.mean(0)
    axis = spreading.var(0).argmax()
    ranks = spreading[:, axis].argsort(stable=True).argsort(stable=True)
    return [colorsys.hsv_to_rgb(0.85 * rank / len(home), 0.9, 1.0) for rank in ranks.tolist()]
