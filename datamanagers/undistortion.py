"""Undistortion: the undistorted camera that stands for a distorted one, and where pixels come from.

The undistorted camera keeps the focal lengths and the orientation. Its image is a rectangle in
what the distorted one shows, as COLMAP's undistorter chooses it (src/colmap/image/undistortion.cc);
we choose each of its sides by itself, where COLMAP moves opposite sides by the worse of the two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float64

from gsfw.core.errors import DataError
from gsfw.core.words import counted, listed
from gsfw.datamanagers.lens import Lens

KEPT = "FISHEYE"
"""COLMAP's name of the fisheye that rasterizers draw: r = f theta."""
KEPT_ANGLE = math.radians(85)
"""From the axis; rasterizers draw only what is in front of the camera, at less than 90 degrees."""
KEPT_SLOPE = math.tan(KEPT_ANGLE)
DIRECTIONS, ANGLE_STEP = 64, math.radians(0.25)
"""Rays along which a lens is tested for folding over."""
LARGEST, SMALLEST = 2.0, 0.2
"""Width and height of an undistorted image as parts of the distorted one's (COLMAP's limits)."""
SAMPLES = 64
"""Pixels per side of the grid on which the lost part of an image is measured."""


@dataclass(frozen=True)
class LensRule:
    """Treatment of images of distorted lenses."""

    keep_fisheye: bool = False
    """True if images of fisheye lenses become those of an ideal fisheye, not of a pinhole."""
    blank_pixels: float = 0.0
    """0: no pixel that the lens did not see; 1: all that it saw. Between: sides move in between."""
    field_of_view: float = 120.0
    """Most degrees that a pinhole image shows, across and down."""


@dataclass(frozen=True)
class Undistortion:
    """Leads from a distorted lens to an undistorted one."""

    source: Lens
    target: Lens
    """A PINHOLE, or the FISHEYE that rasterizers draw."""
    has_blanks: bool
    """True if some pixels of the undistorted image show what the lens did not see."""
    lost: float
    """Part of the distorted image that the undistorted one does not show, in [0, 1]."""

    def look(
        self, pixels: Float64[np.ndarray, "m 2"]
    ) -> tuple[Float64[np.ndarray, "m 2"], Bool[np.ndarray, " m"]]:
        """Source positions of undistorted pixels, and a mask of those that the lens saw."""
        slopes = self.target.unproject(pixels)
        found = self.source.project(slopes)
        if not self.has_blanks:
            return found, np.ones(len(found), dtype=bool)
        size = np.linalg.norm(slopes, axis=1)
        # Outside what a lens sees its model may lead back into the image.
        there = np.linalg.norm(self.source.unproject(found) - slopes, axis=1) < 1e-4 * (1 + size**2)
        return found, there & _within(found, self.source) & (size < KEPT_SLOPE)


@lru_cache(maxsize=4096)
def undistortion_of(lens: Lens, rule: LensRule) -> Undistortion:
    """Choose the undistortion of a lens's images.

    Args:
        lens: in pixels of the stored image.
        rule: what is asked for.

    Raises:
        DataError: the distortion folds the image over, or next to nothing of it would be left.
    """
    _check_folds(lens)
    target = _target(lens, rule)
    centers = np.clip(
        np.concatenate(_border(target)), 0.5, (target.width - 0.5, target.height - 0.5)
    )
    slopes = target.unproject(centers)
    seen = _within(lens.project(slopes), lens) & (np.linalg.norm(slopes, axis=1) < KEPT_SLOPE)
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES
    grid = np.stack(np.meshgrid(steps * lens.width, steps * lens.height), axis=-1).reshape(-1, 2)
    shown = _within(target.project(lens.unproject(grid)), target)
    return Undistortion(lens, target, not bool(seen.all()), 1 - float(shown.mean()))


def _target(lens: Lens, rule: LensRule) -> Lens:
    """The undistorted camera."""
    keeps = rule.keep_fisheye and lens.is_fisheye
    limit = KEPT_ANGLE if keeps else math.tan(math.radians(rule.field_of_view) / 2)
    unit = Lens(
        *(1.0, 1.0, 0.0, 0.0, lens.width, lens.height, lens.source), KEPT if keeps else "PINHOLE"
    )
    left, right, top, bottom = (unit.project(lens.unproject(side)) for side in _border(lens))
    blank = rule.blank_pixels
    x, width = _side(left[:, 0], right[:, 0], limit, blank, lens.fx, lens.width)
    y, height = _side(top[:, 1], bottom[:, 1], limit, blank, lens.fy, lens.height)
    if width < SMALLEST * lens.width or height < SMALLEST * lens.height:
        raise DataError(
            f"{lens.source}: undistorting {lens} would leave {max(width, 0)}x{max(height, 0)} of "
            f"{lens.width}x{lens.height} pixels.",
            "Estimate the camera again, show more (a larger datamanager.field_of_view, or "
            "datamanager.blank_pixels=1) or, for a fisheye, use datamanager.fisheye=keep.",
        )
    return replace(unit, fx=lens.fx, fy=lens.fy, cx=x, cy=y, width=width, height=height)


def _side(
    low: Float64[np.ndarray, " m"],
    high: Float64[np.ndarray, " m"],
    limit: float,
    blank: float,
    focal: float,
    size: int,
) -> tuple[float, int]:
    """The principal point and the size of the undistorted image along one axis, in pixels.

    Args:
        low: where the first border of the distorted image lies, at unit focal length; nan where
            it is out of reach.
        high: where its last border lies.
        limit: how far from the axis the undistorted image may reach.
        blank: ``LensRule.blank_pixels``.
        focal: of both images, in pixels.
        size: of the distorted image, in pixels.
    """
    low = np.nan_to_num(low, nan=-limit).clip(-limit, limit)
    high = np.nan_to_num(high, nan=limit).clip(-limit, limit)
    first = low.max() + blank * (low.min() - low.max())
    last = high.min() + blank * (high.max() - high.min())
    shrink = min(1.0, LARGEST * size / max(focal * (last - first), 1e-9))
    first, last = focal * shrink * first, focal * shrink * last
    # Borders that are straight already end a rounding error away from whole pixels.
    pixels = math.floor(last - first + 1e-3)
    return float(-first - (last - first - pixels) / 2), pixels


def _border(lens: Lens) -> tuple[Float64[np.ndarray, "m 2"], ...]:
    """Points along the left, right, top and bottom border of a lens's image, with its corners."""
    y = np.concatenate([[0.0], np.arange(lens.height) + 0.5, [lens.height]])
    x = np.concatenate([[0.0], np.arange(lens.width) + 0.5, [lens.width]])
    return (
        np.stack([np.zeros_like(y), y], axis=1),
        np.stack([np.full_like(y, lens.width), y], axis=1),
        np.stack([x, np.zeros_like(x)], axis=1),
        np.stack([x, np.full_like(x, lens.height)], axis=1),
    )


def _within(pixels: Float64[np.ndarray, "m 2"], lens: Lens) -> Bool[np.ndarray, " m"]:
    """True if points lie in the image of a lens; false for nan."""
    x, y = pixels[:, 0], pixels[:, 1]
    return (x >= 0) & (x <= lens.width) & (y >= 0) & (y <= lens.height)


def _check_folds(lens: Lens) -> None:
    """Check that rays further from the axis fall further out, as long as they are in the image.

    Raises:
        DataError: they do not; says how far out it ends.
    """
    turns = np.arange(DIRECTIONS) * (2 * math.pi / DIRECTIONS)
    ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    slopes = np.tan(np.arange(ANGLE_STEP, math.radians(89.5), ANGLE_STEP))
    rays = (ways[:, None] * slopes[:, None]).reshape(-1, 2)
    pixels = lens.project(rays).reshape(DIRECTIONS, len(slopes), 2)
    inside = _within(pixels.reshape(-1, 2), lens).reshape(DIRECTIONS, len(slopes))
    outward = (np.diff(pixels, axis=1) * ways[:, None]).sum(axis=2) > 0
    left = inside[:, :-1] & ~inside[:, 1:]
    # A ray that has left the image has no effect on it.
    before = np.cumsum(left, axis=1) == 0
    folded = before & ~outward & inside[:, :-1]
    if not folded.any():
        return
    way, step = np.argwhere(folded)[0]
    reach = float(np.linalg.norm(pixels[way, step] - (lens.cx, lens.cy)))
    corners = [(x, y) for x in (0, lens.width) for y in (0, lens.height)]
    needed = max(math.hypot(x - lens.cx, y - lens.cy) for x, y in corners)
    raise DataError(
        f"{lens.source}: its distortion, {lens}, folds the image over: no ray falls further than "
        f"about {reach:.0f} pixels from the principal point, but the corners are {needed:.0f} "
        "pixels from it.",
        "Estimate the cameras again with a model that fits the lens (OPENCV_FISHEYE for very wide "
        "ones), or with fewer parameters (SIMPLE_RADIAL).",
    )


def undistortion_notes(undistortions: Sequence[Undistortion]) -> tuple[str, ...]:
    """Notes on the undistortion of the images, by lens model."""
    by_model: dict[tuple[str, str], list[Undistortion]] = {}
    for each in undistortions:
        by_model.setdefault((each.source.model, each.target.model), []).append(each)
    return tuple(_note(*models, found) for models, found in by_model.items())


def _note(source: str, target: str, found: list[Undistortion]) -> str:
    lost = max(each.lost for each in found)
    sizes = sorted({(each.target.width, each.target.height) for each in found})
    shown = listed([f"{width}x{height}" for width, height in sizes], 3)
    lenses = len(set(found))
    note = (
        f"{counted(len(found), 'image')} of {counted(lenses, 'lens', 'lenses')} "
        f"undistorted from {source} to {target} ({shown} pixels), for training, evaluation and "
        f"export; up to {100 * lost:.1f} % of an image fall outside"
    )
    if any(each.has_blanks for each in found):
        note += ", and pixels that no lens saw are masked out"
    return note
