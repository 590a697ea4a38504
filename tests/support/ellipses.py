"""Ellipses: random projected for tests of binning, and what each pixel and rectangle sees of them.

All of it is numpy in float64; projected are those of kernels/cuda/sources/stages.h.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsfw.kernels.cuda.jobs import Grid

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TILE = 16
SUBTILE_WIDTH, SUBTILE_HEIGHT = 8, 4
STRIDE = 16
ALPHA_MIN = 1 / 255
LEVEL_MIN = math.log2(ALPHA_MIN)
ROUNDING = 1e-5
"""What float32 may change of an exponent, and thus of where the cut-off lies."""
X, Y, R, WK, W, LEVEL, TILT, TURN, NARROW, HEIGHT, WIDTH = range(11)

LENGTHS = {
    "small": (1e-3, 1.0),
    "round": (2.0, 40.0),
    "huge": (1e3, 1e8),
    "needle": (50.0, 1e5),
    "outside": (10.0, 300.0),
    "faint": (1.0, 100.0),
}
"""Shortest and longest standard deviation of each kind of splat, in pixels."""


@dataclass
class Scene:
    """Brushes and the image that they are rendered in."""

    grid: Grid
    projected: Tensor
    """[n, STRIDE]; NaN where not visible."""
    visible: Tensor
    """uint8 [n]"""
    bounded: bool = True

    @property
    def tiles(self) -> int:
        return self.grid.columns * self.grid.rows

    @property
    def order(self) -> Tensor:
        """int32 [n]: visible ones first, in an order that is not theirs."""
        generator = torch.Generator().manual_seed(7)
        shuffled = torch.randperm(len(self.visible), generator=generator, dtype=torch.int32)
        return shuffled[(1 - self.visible)[shuffled].argsort(stable=True)]


def splats_of(mean: Array, covariance: Array, opacity: Array) -> Array:
    """Brushes [n, STRIDE] as project.cu makes them.

    Means [n, 2] in pixels; covariances [n, 3] (xx, xy, yy), dilated; opacities [n].
    """
    xx, xy, yy = covariance.T
    determinant = xx * yy - xy * xy
    level = np.log2(opacity)
    reach = 2 * math.log(2) * np.maximum(0, level - LEVEL_MIN)
    scale = math.sqrt(math.log2(math.e) / 2)
    projected = np.zeros((len(mean), STRIDE))
    projected[:, X], projected[:, Y] = mean.T
    projected[:, R] = scale / np.sqrt(xx)
    projected[:, W] = scale * np.sqrt(xx / determinant)
    projected[:, WK] = -projected[:, W] * xy / xx
    projected[:, LEVEL] = level
    projected[:, TILT] = xy / yy
    projected[:, TURN] = xy * np.sqrt(reach / xx)
    projected[:, NARROW] = np.sqrt(reach * determinant / yy)
    projected[:, HEIGHT] = np.sqrt(reach * yy)
    projected[:, WIDTH] = np.sqrt(reach * xx)
    return projected


def random_covariances(random: np.random.Generator, kind: str, count: int) -> Array:
    """[n, 3]: xx, xy, yy of one kind of splat, dilated; some are aligned with the axes."""
    low, high = LENGTHS[kind]
    first = np.exp(random.uniform(math.log(low), math.log(high), count))
    second = np.full(count, 0.01) if kind == "needle" else first * random.uniform(0.2, 1, count)
    turn = random.uniform(0, math.pi, count)
    turn[: count // 8] = 0
    turn[count // 8 : count // 4] = math.pi / 2
    cosine, sine = np.cos(turn), np.sin(turn)
    xx = (first * cosine) ** 2 + (second * sine) ** 2 + 0.3
    yy = (first * sine) ** 2 + (second * cosine) ** 2 + 0.3
    return np.stack([xx, (first**2 - second**2) * cosine * sine, yy], axis=1)


def random_scene(
    kind: str, size: tuple[int, int], dtype: torch.dtype, count: int = 60, seed: int = 0
) -> Scene:
    """Splats of one of the ``LENGTHS``; some of them are not visible."""
    random = np.random.default_rng(seed)
    mean = random.uniform(-0.2, 1.2, (count, 2)) * size
    if kind == "outside":
        side = random.choice([-1, 1], (count, 2))
        mean = np.array(size) / 2 + side * (np.array(size) / 2 + random.uniform(0, 900, (count, 2)))
    opacity = random.uniform(0.001, 1, count)
    if kind == "faint":
        opacity = ALPHA_MIN * (1 + random.choice([0, 1e-6, 1e-3, 0.1], count))
    projected = splats_of(mean, random_covariances(random, kind, count), opacity)
    extent = projected[:, [WIDTH, HEIGHT]]
    visible = ((mean + extent > 0) & (mean - extent < size)).all(1) & (opacity >= ALPHA_MIN)
    visible &= random.uniform(size=count) > 0.1
    projected[~visible] = math.nan
    grid = Grid(*size, -(-size[0] // TILE), -(-size[1] // TILE))
    seen = torch.from_numpy(visible.astype(np.uint8))
    return Scene(grid, torch.from_numpy(projected).to(dtype), seen)


def exponents(splat: Array, x: Array, y: Array) -> Array:
    """log2 of the alpha of a splat at positions in pixels, as the blend has it."""
    across, down = x - splat[X], y - splat[Y]
    return splat[LEVEL] - (splat[R] * across) ** 2 - (splat[W] * down + splat[WK] * across) ** 2


def drawn_subtiles(grid: Grid, splat: Array) -> Integers:
    """[tiles]: bits of the subtiles in which a pixel reaches the least alpha."""
    x, y = np.meshgrid(np.arange(grid.width), np.arange(grid.height))
    rendered = exponents(splat, x + 0.5, y + 0.5) >= LEVEL_MIN + ROUNDING
    bits = np.zeros(grid.columns * grid.rows, dtype=np.int64)
    tile = y // TILE * grid.columns + x // TILE
    subtile = y % TILE // SUBTILE_HEIGHT * 2 + x % TILE // SUBTILE_WIDTH
    np.bitwise_or.at(bits, tile[rendered], 1 << subtile[rendered])
    return bits


def highest_exponents(splat: Array, low: Array, high: Array) -> Array:
    """[m]: the largest exponent within rectangles from ``low`` to ``high`` ([m, 2], pixels)."""
    a = splat[R] ** 2 + splat[WK] ** 2
    b, c = splat[W] * splat[WK], splat[W] ** 2
    center = splat[[X, Y]]
    best = np.full(len(low), -np.inf)
    for edge in (low, high):
        across, down = (edge - center).T
        y = np.clip(center[1] - b * across / c, low[:, 1], high[:, 1])
        x = np.clip(center[0] - b * down / a, low[:, 0], high[:, 0])
        best = np.maximum(best, exponents(splat, edge[:, 0], y))
        best = np.maximum(best, exponents(splat, x, edge[:, 1]))
    within = ((low <= center) & (center <= high)).all(1)
    return np.where(within, splat[LEVEL], best)


def reached(grid: Grid, splat: Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    """[tiles, rectangles of a tile]: which rectangles of ``size`` pixels an ellipse may meet.

    It does if it comes closer to their pixel centres than the slack of reach.h.
    """
    tile = np.arange(grid.columns * grid.rows)[:, None]
    across = TILE // size[0]
    part = np.arange(across * (TILE // size[1]))
    left = tile % grid.columns * TILE + part % across * size[0]
    top = tile // grid.columns * TILE + part // across * size[1]
    slack = 2e-3 + 2e-5 * splat[[WIDTH, HEIGHT]]
    low = np.stack([left, top], axis=-1).reshape(-1, 2) + 0.5
    high = low + np.array(size) - 1
    best = highest_exponents(splat, low - slack, high + slack)
    return (best >= LEVEL_MIN - ROUNDING).reshape(left.shape)
