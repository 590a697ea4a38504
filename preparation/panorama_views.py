"""Panorama views: the views of a pinhole camera that stand for a panorama of all directions.

Six views of 90 degrees look around, 60 degrees from each to the next, so that what lies on the
edge of one is whole in another; two more look up and down. All have one centre, and turns that are
known exactly.

A panorama is equirectangular: x is the longitude, from left to right, and y the latitude, from top
to bottom. Its axes are those of a camera that looks at its middle: x right, y down, z ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, UInt8

from gsfw.datamanagers.images import fit_image
from gsfw.datamanagers.warp import ROWS, MapCache, Warp

EDGE = 4
"""Columns and rows that continue a panorama beyond its edges, for kernels that reach over them."""
ODD = 0.02
"""Deviation of the proportions from 2:1, in parts of the width, of some programs' panoramas."""
SMALLEST = 256
"""Least width of a panorama that is cut; views of less than 80 pixels have no features."""


@dataclass(frozen=True)
class Direction:
    """The direction of a view."""

    name: str
    """Ends the names of its files."""
    yaw: float
    """Degrees to the right of the middle of the panorama."""
    pitch: float
    """Degrees above it."""

    @property
    def from_panorama(self) -> Float64[np.ndarray, "3 3"]:
        """Turns the axes of the panorama to those of the view."""
        yaw, pitch = math.radians(self.yaw), math.radians(self.pitch)
        about_y = np.array(
            [[math.cos(yaw), 0, -math.sin(yaw)], [0, 1, 0], [math.sin(yaw), 0, math.cos(yaw)]]
        )
        about_x = np.array(
            [
                [1, 0, 0],
                [0, math.cos(pitch), math.sin(pitch)],
                [0, -math.sin(pitch), math.cos(pitch)],
            ]
        )
        turn: Float64[np.ndarray, "3 3"] = about_x @ about_y
        return turn


DIRECTIONS = (
    *(Direction(f"{yaw:03d}", float(yaw), 0.0) for yaw in range(0, 360, 60)),
    Direction("up", 0.0, 90.0),
    Direction("down", 0.0, -90.0),
)
"""All of them; a view is named by its position here."""
AROUND = 6
"""The first so many look around."""


def has_proportions(width: int, height: int) -> bool:
    """True for the proportions of a panorama of all directions."""
    return abs(width - 2 * height) <= ODD * width


def view_side(width: int) -> int:
    """Width and height of a view, in pixels, of a panorama of ``width`` pixels; even.

    A pixel in the middle of a view has the size of one of the panorama, so that no detail is lost.
    """
    return 2 * round(width / (2 * math.pi))


@dataclass(frozen=True)
class Size:
    """Size of an image in pixels."""

    width: int
    height: int


@dataclass(frozen=True)
class Cut:
    """Leads from the pixels of a view to those of its panorama; see ``warp.Resampling``."""

    size: Size
    """Size of the panorama."""
    direction: Direction

    @property
    def source(self) -> Size:
        """The panorama with its continuation."""
        return Size(self.size.width + 2 * EDGE, self.size.height + 2 * EDGE)

    @property
    def target(self) -> Size:
        """The view."""
        side = view_side(self.size.width)
        return Size(side, side)

    @property
    def has_blanks(self) -> bool:
        """A panorama has all directions."""
        return False

    def look(
        self, pixels: Float64[np.ndarray, "m 2"]
    ) -> tuple[Float64[np.ndarray, "m 2"], Bool[np.ndarray, " m"]]:
        """Positions of the view's pixels in the continued panorama."""
        places = _places(pixels, self.target.width, self.direction)
        places *= (self.size.width, self.size.height)
        return places + EDGE, np.ones(len(pixels), dtype=bool)


def continued(panorama: UInt8[np.ndarray, "h w d"]) -> UInt8[np.ndarray, "h2 w2 d"]:
    """A panorama with ``EDGE`` more pixels on every side: what comes beyond its edges.

    Beyond a pole, the other side of the globe comes upside down.
    """
    half = panorama.shape[1] // 2
    above = np.roll(panorama[:EDGE][::-1], half, axis=1)
    below = np.roll(panorama[-EDGE:][::-1], half, axis=1)
    whole = np.concatenate([above, panorama, below])
    return np.concatenate([whole[:, -EDGE:], whole, whole[:, :EDGE]], axis=1)


def cut(
    whole: UInt8[np.ndarray, "h w d"], direction: Direction, maps: MapCache
) -> UInt8[np.ndarray, "s s d"]:
    """One view of a panorama.

    Args:
        whole: as of ``continued``.
        direction: of the view.
        maps: keeps the positions of pixels for the next panorama of this size.
    """
    size = Size(whole.shape[1] - 2 * EDGE, whole.shape[0] - 2 * EDGE)
    view = Cut(size, direction)
    side = view.target.width
    return fit_image(whole, None, side, side, Warp(view, maps)).pixels


def cut_mask(
    mask: Bool[np.ndarray, "h w"], side: int, direction: Direction
) -> Bool[np.ndarray, "s s"]:
    """The mask of one view, by the nearest pixel of that of the panorama.

    Args:
        mask: of all directions, at any size.
        side: width and height of the view in pixels.
        direction: of the view.
    """
    height, width = mask.shape
    view = np.empty((side, side), dtype=bool)
    for top in range(0, side, ROWS):
        y, x = np.mgrid[top : min(top + ROWS, side), :side].reshape(2, -1) + 0.5
        across, down = _places(np.stack([x, y], axis=1), side, direction).T
        columns = (across * width).astype(np.int64) % width
        rows = (down * height).astype(np.int64).clip(0, height - 1)
        view[top : top + ROWS] = mask[rows, columns].reshape(-1, side)
    return view


def _places(
    pixels: Float64[np.ndarray, "m 2"], side: int, direction: Direction
) -> Float64[np.ndarray, "m 2"]:
    """Positions of a view's pixels in the panorama, in parts of its width and height."""
    half = side / 2
    rays = np.concatenate([pixels / half - 1, np.ones((len(pixels), 1))], axis=1)
    x, y, z = (rays @ direction.from_panorama).T
    across = np.arctan2(x, z) / (2 * math.pi) + 0.5
    down = np.arctan2(y, np.hypot(x, z)) / math.pi + 0.5
    return np.stack([across, down], axis=1)


def map_bytes(width: int, views: int) -> int:
    """Memory of the positions of all pixels of some views, for ``MapCache``."""
    return 8 * view_side(width) ** 2 * views
