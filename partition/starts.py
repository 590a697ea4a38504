"""Starts: the Gaussians that a block begins with, from the coarse model of the whole scene.

Liu et al., CityGaussian (ECCV 2024), section 3.2, start blocks from a coarse global model; Kerbl et
al., A Hierarchical 3D Gaussian Representation (SIGGRAPH 2024), section 5, keep a coarse scaffold as
the background of each chunk. Here the rest that the block's views look at is trained along, and
dropped when blocks are merged: without it, Gaussians of the block would stand in for it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from gsfw.core.datamanager import Split
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.spherical_harmonics import num_coefficients, rgb_to_dc
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh, Splats
from gsfw.datamanagers.capture import Capture
from gsfw.formats.ply import PlyExporter
from gsfw.partition.block_data import places_of
from gsfw.partition.document import Block
from gsfw.partition.ground import Ground

OPACITY = 0.1
"""Opacity of new Gaussians at points, as in Kerbl et al. 2023."""
NEIGHBORS = 3
"""Neighbours whose mean distance is the size of a new Gaussian, as there."""
BEYOND = 0.1
"""Part of an image's sides by which Gaussians may lie outside of it and still be seen."""


def write_start(
    path: Path,
    block: Block,
    coarse: SplatFile,
    data: Capture,
    used: Bool[np.ndarray, " p"],
    ground: Ground,
    *,
    rest: bool,
) -> int:
    """Write the Gaussians that a block begins with, in the world; their number.

    They are the coarse model's in the cell and its margin, new ones at the points there that the
    coarse model left out, and the rest of the coarse model that the block's views may see.

    Args:
        path: the file, a PLY with positions in double precision.
        block: the block.
        coarse: the coarse model, in the world of the data.
        data: the whole data set.
        used: the points of the data set that the coarse model started from.
        ground: of the partition.
        rest: false to leave out the rest.

    Raises:
        OutputError: the file cannot be written.
    """
    splats = coarse.splats
    own = torch.from_numpy(block.cell.holds(ground.places(splats.means.numpy()), block.margin))
    kept = own | _seen(splats.means, block, data) if rest else own
    parts = [splats.take(kept.nonzero()[:, 0])]
    points, colors = data.recording.points, data.recording.point_colors
    new = block.cell.holds(places_of(points, ground), block.margin) & ~used
    if new.any():
        chosen = torch.from_numpy(new)
        parts.append(_at_points(points[chosen], colors[chosen], splats.sh_degree))
    joined = parts[0] if len(parts) == 1 else Splats.cat(parts)
    PlyExporter(positions="double").write(path, replace(coarse, splats=joined))
    return len(joined)


def _seen(means: Float64[Tensor, "n 3"], block: Block, data: Capture) -> Bool[Tensor, " n"]:
    """True for Gaussians whose centre is in, or close to, the image of a view of the block."""
    world = data.scene.world_from_scene
    places = world.inverse().apply(means)
    views, wanted = data.views(Split.TRAIN), set(block.train)
    found = torch.zeros(len(means), dtype=torch.bool)
    for name, camera in zip(views.names, views.cameras, strict=True):
        if name not in wanted:
            continue
        pose, matrix = camera.world_to_camera[0].double(), camera.intrinsics[0].double()
        local = places @ pose[:3, :3].T + pose[:3, 3]
        depths = local[:, 2]
        pixels = local[:, :2] / depths.clamp_min(1e-12)[:, None]
        pixels = pixels * matrix.diagonal()[:2] + matrix[:2, 2]
        size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
        inside = (pixels > -BEYOND * size) & (pixels < (1 + BEYOND) * size)
        found |= (depths > 0) & inside.all(1)
    return found


def _at_points(
    points: Float64[Tensor, "p 3"], colors: Float64[Tensor, "p 3"], degree: int
) -> Splats:
    """Isotropic Gaussians at points, in the world of the data."""
    count = len(points)
    # Relative to their middle, float32 resolves their distances.
    near = (points - points.mean(0)).float()
    distances = Operators().neighbor_distances(near, NEIGHBORS)
    there = distances.isfinite()
    spacing = distances.where(there, 0.0).sum(1) / there.sum(1).clamp_min(1)
    spacing = spacing.double().clamp_min(1e-9 * float(near.abs().max()) + 1e-300)
    coefficients = torch.zeros(count, num_coefficients(degree), 3)
    coefficients[:, 0] = rgb_to_dc(colors.float())
    return Splats(
        means=points.double(),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=torch.float64).repeat(count, 1),
        scales=spacing[:, None].repeat(1, 3),
        opacities=torch.full((count,), OPACITY, dtype=torch.float64),
        colors=Sh(coefficients, degree),
    )
