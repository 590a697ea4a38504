"""Catalogue: instances of every kernel, to prove that they compile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from gsfw.kernels.cuda.field_jobs import (
    GridDistanceJob,
    GridVariationJob,
    HashBackwardJob,
    HashJob,
    PenaltyJob,
    PlaneProductBackwardJob,
    PlaneProductJob,
    SliceBackwardJob,
    SliceJob,
)
from gsfw.kernels.cuda.instances import HASH_WIDTHS, NAMES, Instances
from gsfw.kernels.cuda.jobs import (
    BlendBackwardJob,
    BlendJob,
    CountsJob,
    EmitJob,
    ProjectBackwardJob,
    ProjectJob,
    TilesJob,
)
from gsfw.kernels.cuda.launcher import Entry, Kernel
from gsfw.kernels.cuda.neighbors import neighbors_kernel
from gsfw.kernels.cuda.sort import sort_kernels
from gsfw.kernels.cuda.step_jobs import (
    AdamJob,
    FiniteJob,
    LossesJob,
    NeighborsJob,
    SsimBackwardJob,
    SsimJob,
)

CHANNELS = (1, 3, 4, 16, 32)
"""Numbers of channels to blend with."""

DEGREES = (-1, 0, 1, 2, 3)
"""Degrees of spherical harmonics; -1 for plain channels."""


def catalogue(dtype: torch.dtype = torch.float32, degrees: Sequence[int] = DEGREES) -> list[Entry]:
    """The kernels that users are likely to need.

    Args:
        dtype: float32 or float64.
        degrees: those of the spherical harmonics to project with.
    """
    number = NAMES[dtype]
    return [
        *_projections(dtype, degrees),
        *_blends(dtype),
        *_bins(dtype),
        *_steps(number),
        *_fields(number),
        *_neighbors(dtype),
    ]


def _projections(dtype: torch.dtype, degrees: Sequence[int]) -> list[Entry]:
    entries: list[Entry] = []
    for covariances, degree in [*((False, degree) for degree in degrees), (True, degrees[-1])]:
        chosen = Instances(dtype, covariances, degree, 3, torch.int16)
        entries.append((chosen.project, ProjectJob))
        entries.append((chosen.project_backward(pose=False), ProjectBackwardJob))
    last = Instances(dtype, False, degrees[-1], 3, torch.int16)
    ragged = replace(last, ragged=True)
    return [
        *entries,
        (last.project_backward(pose=True), ProjectBackwardJob),
        (ragged.project, ProjectJob),
        (ragged.project_backward(pose=False), ProjectBackwardJob),
    ]


def _blends(dtype: torch.dtype) -> list[Entry]:
    entries: list[Entry] = []
    for channels, measured in [*((channels, False) for channels in CHANNELS), (3, True)]:
        chosen = Instances(dtype, False, -1, channels, torch.int16)
        entries.append((chosen.blend(measured), BlendJob))
        entries.append((chosen.blend_backward(measured), BlendBackwardJob))
    return entries


def _bins(dtype: torch.dtype) -> list[Entry]:
    depth = torch.int32 if dtype == torch.float32 else torch.int64
    entries: list[Entry] = [*sort_kernels(depth), *sort_kernels(torch.int16)]
    for tile_key in (torch.int16, torch.int32):
        chosen = Instances(dtype, False, -1, 3, tile_key)
        entries += [(chosen.emit, EmitJob), (chosen.find_tiles, TilesJob)]
    return [*entries, (chosen.sum_counts, CountsJob)]


def _steps(number: str) -> list[Entry]:
    return [
        (Kernel("ssim.cu", f"ssim<{number}>"), SsimJob),
        (Kernel("ssim.cu", f"add_losses<{number}>"), LossesJob),
        (Kernel("ssim.cu", f"ssim_backward<{number}>"), SsimBackwardJob),
        (Kernel("adam.cu", f"begin_adam<{number}>"), AdamJob),
        (Kernel("adam.cu", f"adam<{number}>"), AdamJob),
        (Kernel("finite.cu", f"check_finite<{number}>"), FiniteJob),
    ]


def _fields(number: str) -> list[Entry]:
    entries: list[Entry] = [
        (Kernel(f"{source}.cu", f"{name}<{number}>"), job)
        for source, name, job in (
            ("plane_product", "plane_product", PlaneProductJob),
            ("plane_product", "plane_product_backward", PlaneProductBackwardJob),
            ("grid_variation", "grid_variation", GridVariationJob),
            ("grid_variation", "grid_variation_backward", GridVariationJob),
            ("grid_variation", "grid_distance", GridDistanceJob),
            ("grid_variation", "grid_distance_backward", GridDistanceJob),
            ("grid_variation", "add_penalty", PenaltyJob),
            ("slice", "slice", SliceJob),
            ("slice", "slice_backward", SliceBackwardJob),
        )
    ]
    for width in HASH_WIDTHS:
        arguments = f"{number}, {width}"
        forward = Kernel("hash_features.cu", f"hash_features<{arguments}>")
        backward = Kernel("hash_features.cu", f"hash_features_backward<{arguments}>")
        entries += [(forward, HashJob), (backward, HashBackwardJob)]
    return entries


def _neighbors(dtype: torch.dtype) -> list[Entry]:
    """The instances of methods 4d-rotor and dynamic3dgs."""
    return [(neighbors_kernel(dtype, axes, k), NeighborsJob) for axes, k in ((4, 8), (3, 20))]
