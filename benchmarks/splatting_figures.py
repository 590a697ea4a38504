"""The figures of docs/explain/how-splatting-works.md, from the rasterizers themselves.

    OMP_NUM_THREADS=1 python benchmarks/splatting_figures.py [FOLDER]

writes splatting-projection.png, splatting-blending.png, splatting-harmonics.png and
splatting-tiles.png to FOLDER (docs/images when left out), in some seconds on one core. Everything
is rendered in float64 by the reference; no model is trained.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from printing import say_size
from torch import Tensor

from gsfw.charts.style import INK, SERIES, new_figure, place, styled, write, write_figure
from gsfw.core.cameras import Cameras
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.maths.spherical_harmonics import num_coefficients, sh_basis
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.bin import TILE, bin_ellipses
from gsfw.rasterizers.reference.project import Ellipses, project
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SETTINGS = RenderSettings(background=torch.ones(3, dtype=torch.float64))
REFERENCE = ReferenceRasterizer()
MOST_BYTES = 150_000
"""Largest file that a page should load."""
DRAWN = 1200
"""Random points of a Gaussian, of which a figure shows its exact projection."""


def camera(width: int, height: int, focal: float) -> Cameras:
    """At the origin, along +z; ``focal`` in pixels."""
    matrix = [[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]
    intrinsics = torch.tensor([matrix], dtype=torch.float64)
    return Cameras(torch.eye(4, dtype=torch.float64)[None], intrinsics, width, height)


def gaussians(
    means: list[list[float]],
    scales: list[list[float]],
    quats: list[list[float]],
    opacities: list[float],
    colors: list[list[float]],
) -> Splats:
    """Splats of plain numbers, in float64."""
    tensors = [torch.tensor(field, dtype=torch.float64) for field in (means, quats, scales)]
    return Splats(
        means=tensors[0],
        opacities=torch.tensor(opacities, dtype=torch.float64),
        colors=torch.tensor(colors, dtype=torch.float64),
        quats=tensors[1],
        scales=tensors[2],
    )


def image(splats: Splats, view: Cameras) -> np.ndarray:
    """Colours of a render, as ``imshow`` takes them."""
    return REFERENCE.render(splats, view, SETTINGS).color[0].clamp(0, 1).numpy()


def show(axes: Axes, pixels: np.ndarray, title: str) -> None:
    """An image in pixel coordinates: the middle of the first pixel is (0.5, 0.5)."""
    height, width = pixels.shape[:2]
    axes.imshow(pixels, extent=(0, width, height, 0), interpolation="nearest", vmin=0)
    axes.set_title(title)
    axes.grid(visible=False)
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)


def outline(ellipses: Ellipses, reach: float) -> np.ndarray:
    """The ellipse at ``reach`` standard deviations of the first Gaussian, [points, 2]."""
    xx, xy, yy = ellipses.covariances[0].tolist()
    axes = np.linalg.cholesky(np.array([[xx, xy], [xy, yy]]))
    turn = np.linspace(0, 2 * math.pi, 100)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    return (ellipses.means[0].numpy()[:, None] + reach * axes @ circle).T


def exact_points(splats: Splats, view: Cameras) -> Tensor:
    """Exact projections of random points of the first Gaussian, in pixels."""
    generator = torch.Generator().manual_seed(0)
    normal = torch.randn(DRAWN, 3, generator=generator, dtype=torch.float64)
    assert splats.quats is not None
    assert splats.scales is not None
    points = splats.means[0] + (normal * splats.scales[0]) @ rotation_matrices(splats.quats)[0].T
    points = points[points[:, 2] > 0.05]
    pixels = points @ view.intrinsics[0].T
    return pixels[:, :2] / pixels[:, 2:]


@styled
def projection() -> Figure:
    """A Gaussian far away, the same one near, and its image."""
    shape = {"scales": [[0.5, 0.16, 0.16]], "quats": [[0.85, 0.1, 0.45, 0.25]]}
    rest = {"opacities": [0.95], "colors": [[0.12, 0.36, 0.67]]}
    figure = new_figure(930, 330)
    for column, (distance, focal, title) in enumerate(
        [(5.0, 250.0, "far: the ellipse fits"), (0.9, 36.0, "near: the ellipse is only tangent")]
    ):
        view = camera(96, 96, focal)
        splats = gaussians([[0.1, 0.0, distance]], **shape, **rest)
        ellipses = project(splats, view, SETTINGS)
        points = exact_points(splats, view)
        axes = place(figure, 20 + 300 * column, 40, 300 + 300 * column, 320)
        show(axes, np.ones((96, 96, 3)), title)
        axes.scatter(*points.T.numpy(), s=2.0, color=SERIES[1], linewidths=0, alpha=0.5)
        for reach in (1, 2, 3):
            axes.plot(*outline(ellipses, reach).T, color=SERIES[0], linewidth=1.4)
        axes.set_xlim(0, 96)
        axes.set_ylim(96, 0)
    view = camera(96, 96, 250.0)
    splats = gaussians([[0.1, 0.0, 5.0]], **shape, **rest)
    axes = place(figure, 620, 40, 900, 320)
    show(axes, image(splats, view), "rendered; dashed: alpha = 1/255")
    ellipses = project(splats, view, SETTINGS)
    edge = math.sqrt(2 * math.log(0.95 / DEFAULT.alpha_min))
    axes.plot(*outline(ellipses, edge).T, color=INK, linewidth=1, linestyle=(0, (4, 3)))
    return figure


@styled
def blending() -> Figure:
    """Three Gaussians that overlap, and what each adds to one pixel."""
    names = ("orange", "green", "blue")
    splats = gaussians(
        means=[[-0.25, 0.0, 3.0], [0.2, -0.2, 4.0], [0.2, 0.35, 5.0]],
        scales=[[0.30, 0.16, 0.1], [0.42, 0.22, 0.1], [0.55, 0.45, 0.1]],
        quats=[[1.0, 0.0, 0.0, 0.2], [1.0, 0.0, 0.0, -0.3], [1.0, 0.0, 0.0, 0.1]],
        opacities=[0.7, 0.8, 0.95],
        colors=[[0.85, 0.4, 0.15], [0.2, 0.55, 0.3], [0.12, 0.36, 0.67]],
    )
    view, spot = camera(96, 72, 110.0), (48, 36)
    one_pixel = torch.zeros(1, 72, 96, 1, dtype=torch.float64)
    one_pixel[0, spot[1], spot[0]] = 1.0
    weights = REFERENCE.contributions(splats, view, one_pixel, SETTINGS)[0].tolist()
    figure = new_figure(930, 320)
    axes = place(figure, 20, 40, 380, 310)
    show(axes, image(splats, view), "the image, and one pixel of it")
    axes.plot(spot[0] + 0.5, spot[1] + 0.5, "s", color=INK, markersize=8, markerfacecolor="none")
    axes = place(figure, 480, 40, 900, 262)
    remaining = 1.0
    for row, weight in enumerate(weights):
        color = splats.colors[row].tolist()  # type: ignore[index]
        axes.barh(row, remaining, color="#e4e4e8", height=0.62)
        axes.barh(row, weight, color=color, height=0.62)
        text = f"T = {remaining:.2f}, alpha = {weight / remaining:.2f}: weight {weight:.2f}"
        axes.text(1.0, row - 0.42, text, fontsize=8, ha="right")
        remaining -= weight
    axes.barh(3, remaining, color="#e4e4e8", height=0.62)
    axes.text(1.0, 2.58, f"T = {remaining:.2f}: what the background adds", fontsize=8, ha="right")
    axes.set_yticks(range(4), [*names, "background"])
    axes.set_ylim(3.5, -0.7)
    axes.set_xlim(0, 1)
    axes.set_title("front to back: grey is the light that is left, T")
    axes.set_xlabel("part of the pixel")
    axes.grid(axis="y", visible=False)
    return figure


def sphere(size: int) -> tuple[Tensor, np.ndarray]:
    """Directions of the visible half of a sphere [size, size, 3], and where it is."""
    steps = torch.linspace(-1, 1, size, dtype=torch.float64)
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    inside = x * x + y * y < 1
    z = (1 - x * x - y * y).clamp(min=0).sqrt()
    return torch.stack([x, y, -z], dim=-1), inside.numpy()


@styled
def harmonics() -> Figure:
    """The functions of degrees 0 to 3, and a highlight as each degree fits it."""
    directions, inside = sphere(48)
    basis = sh_basis(3, directions).numpy()
    figure = new_figure(930, 350)
    for degree in range(4):
        write(figure, 20, 62 + 78 * degree, f"degree {degree}", size=9)
        for order in range(2 * degree + 1):
            axes = place(
                figure,
                *(90 + 62 * order, 34 + 78 * degree),
                *(148 + 62 * order, 92 + 78 * degree),
            )
            values = basis[..., degree * degree + order]
            axes.imshow(
                np.where(inside, values, np.nan),
                interpolation="nearest",
                cmap="RdBu_r",
                vmin=-0.75,
                vmax=0.75,
            )
            axes.axis("off")
    write(figure, 300, 16, "the 16 functions: blue below 0, red above", bold=True, align="center")
    axes = place(figure, 610, 40, 905, 300)
    highlight_lines(axes)
    return figure


def highlight_lines(axes: Axes) -> None:
    """Brightness over the angle of view: a highlight, and its best fit of each degree."""
    generator = torch.Generator().manual_seed(0)
    seen = torch.randn(20_000, 3, generator=generator, dtype=torch.float64)
    seen = seen / seen.norm(dim=1, keepdim=True)
    angles = torch.linspace(-math.pi, math.pi, 200, dtype=torch.float64)
    path = torch.stack([angles.sin(), 0 * angles, -angles.cos()], dim=1)

    def highlight(directions: Tensor) -> Tensor:
        return 0.25 + 0.65 * torch.exp(6 * (-directions[:, 2] - 1))

    across = np.degrees(angles.numpy())
    axes.plot(across, highlight(path).numpy(), color=INK, linewidth=2.2, label="a highlight")
    for degree in range(4):
        count = num_coefficients(degree)
        fit = torch.linalg.lstsq(sh_basis(3, seen)[:, :count], highlight(seen)[:, None]).solution
        curve = (sh_basis(3, path)[:, :count] @ fit)[:, 0].clamp(min=0)
        axes.plot(across, curve.numpy(), color=SERIES[degree], label=f"degree {degree}")
    axes.set_xticks([-180, -90, 0, 90, 180])
    axes.set_xlabel("direction of view, degrees")
    axes.set_title("one colour channel of a Gaussian")
    axes.set_ylim(0, 1)
    axes.legend(fontsize=8)


@styled
def tiles() -> Figure:
    """The tiles that one ellipse meets, and the work of each tile in an image of many."""
    view = camera(96, 72, 110.0)
    one = gaussians(
        [[0.0, 0.0, 4.0]], [[0.42, 0.08, 0.1]], [[1.0, 0.0, 0.0, 0.32]], [0.9], [[0.12, 0.36, 0.67]]
    )
    generator = torch.Generator().manual_seed(3)
    count = 220
    spread = torch.rand(count, 3, generator=generator, dtype=torch.float64)
    around = (spread - 0.5) * torch.tensor([2.8, 2.0, 2.0]) + torch.tensor([0.0, 0.0, 4.0])
    around[:, 0] += 0.5 * around[:, 0].abs()
    many = gaussians(
        around.tolist(),
        (0.03 + 0.12 * torch.rand(count, 3, generator=generator)).tolist(),
        torch.randn(count, 4, generator=generator).tolist(),
        (0.3 + 0.6 * torch.rand(count, generator=generator)).tolist(),
        torch.rand(count, 3, generator=generator).tolist(),
    )
    figure = new_figure(930, 300)
    axes = place(figure, 20, 40, 300, 250)
    show(axes, image(one, view), f"one ellipse, and tiles of {TILE} x {TILE}")
    grid(axes, view)
    mark(axes, one, view)
    axes = place(figure, 330, 40, 610, 250)
    show(axes, image(many, view), f"{count} Gaussians")
    axes = place(figure, 640, 40, 920, 250)
    counts = counts_of(many, view)
    show(axes, counts.repeat(TILE, 0).repeat(TILE, 1), "Gaussians that each tile blends")
    for row, line in enumerate(counts):
        for column, number in enumerate(line):
            place_of = ((column + 0.5) * TILE, (row + 0.5) * TILE)
            axes.text(*place_of, str(number), fontsize=5.5, color="white", ha="center", va="center")
    write(
        figure,
        160,
        272,
        "filled: tiles it meets; outlined: its bounding box",
        size=8,
        align="center",
    )
    return figure


def counts_of(splats: Splats, view: Cameras) -> np.ndarray:
    """Number of ellipses that meet each tile, [rows, columns]."""
    ellipses = project(splats, view, SETTINGS)
    bins = bin_ellipses(ellipses, view, DEFAULT, pairs_mb=64)
    return bins.counts.view(-1, bins.columns).numpy()


def grid(axes: Axes, view: Cameras) -> None:
    """Borders of the tiles."""
    for x in range(0, view.width + 1, TILE):
        axes.axvline(x, color="#b0b0b6", linewidth=0.5)
    for y in range(0, view.height + 1, TILE):
        axes.axhline(y, color="#b0b0b6", linewidth=0.5)


def mark(axes: Axes, splats: Splats, view: Cameras) -> None:
    """Fill the tiles that the only ellipse meets; outline the tiles of its bounding box."""
    from matplotlib.patches import Rectangle

    met = np.argwhere(counts_of(splats, view) > 0)
    for row, column in met:
        axes.add_patch(
            Rectangle((column * TILE, row * TILE), TILE, TILE, color=SERIES[1], alpha=0.25, lw=0)
        )
    (top, left), (bottom, right) = met.min(0) * TILE, (met.max(0) + 1) * TILE
    axes.add_patch(
        Rectangle((left, top), right - left, bottom - top, fill=False, color=SERIES[1], lw=1.6)
    )


def main(folder: Path) -> None:
    """Write all figures, and check their sizes."""
    for figure in (projection, blending, harmonics, tiles):
        file = folder / f"splatting-{figure.__name__}.png"
        write_figure(file, figure())
        say_size(file, MOST_BYTES)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs/images"))
    main(parser.parse_args().folder)
