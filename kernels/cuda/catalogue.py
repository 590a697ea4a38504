"""Catalogue: instances of every kernel, to prove that they compile."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

from gsfw.kernels.cuda.jobs import (
    BlendBackwardJob,
    BlendJob,
    EmitJob,
    ProjectBackwardJob,
    ProjectJob,
    TilesJob,
)
from gsfw.kernels.cuda.launcher import Kernel
from gsfw.kernels.cuda.sort_jobs import DigitsJob, ScatterJob
from gsfw.kernels.cuda.step_jobs import (
    AdamJob,
    BeginAdamJob,
    FiniteJob,
    LossesJob,
    SsimBackwardJob,
    SsimJob,
)

Entry = tuple[Kernel, type[ctypes.Structure]]
"""A kernel, and the job that it takes."""

CHUNKS = {
    "float": {1: 128, 3: 128, 4: 128, 16: 64, 32: 32},
    "double": {1: 64, 3: 64, 4: 64, 16: 32, 32: 32},
}
"""Splats of a tile between two checkpoints, by type of number and number of channels."""

DEGREES = (-1, 0, 1, 2, 3)
"""Of spherical harmonics; -1 for plain channels."""


def catalogue(number: str = "float", degrees: Sequence[int] = DEGREES) -> list[Entry]:
    """The kernels that users are likely to need.

    Args:
        number: "float" or "double".
        degrees: those of the spherical harmonics to project with.
    """
    return [
        *_projections(number, degrees),
        *_blends(number),
        *_bins(number),
        *_steps(number),
    ]


def _projections(number: str, degrees: Sequence[int]) -> list[Entry]:
    entries: list[Entry] = []
    last = degrees[-1]
    forms = [(f"Axes<{number}>", degree, "false") for degree in degrees]
    forms += [(f"Axes<{number}>", last, "true"), (f"Symmetric3<{number}>", last, "false")]
    for shape, degree, pose in forms:
        of = f"{number}, {shape}, {degree}"
        if pose == "false":
            entries.append((Kernel("project.cu", f"project<{of}>"), ProjectJob))
        back = Kernel("project_backward.cu", f"project_backward<{of}, {pose}>")
        entries.append((back, ProjectBackwardJob))
    return entries


def _blends(number: str) -> list[Entry]:
    entries: list[Entry] = []
    forms = [(channels, "false") for channels in CHUNKS[number]]
    for channels, measured in [*forms, (3, "true")]:
        of = f"{number}, {channels}, {CHUNKS[number][channels]}, {measured}"
        entries.append((Kernel("blend.cu", f"blend<{of}>"), BlendJob))
        entries.append((Kernel("blend_backward.cu", f"blend_backward<{of}>"), BlendBackwardJob))
    return entries


def _bins(number: str) -> list[Entry]:
    depth = "uint32" if number == "float" else "uint64"
    entries: list[Entry] = [
        (Kernel("sort.cu", f"count_digits<{depth}>"), DigitsJob),
        (Kernel("sort.cu", f"scatter<{depth}>"), ScatterJob),
    ]
    for key in ("uint16", "uint32"):
        entries.append((Kernel("bin.cu", f"emit<{number}, {key}>"), EmitJob))
        entries.append((Kernel("bin.cu", f"find_tiles<{key}>"), TilesJob))
    entries.append((Kernel("sort.cu", "count_digits<uint16>"), DigitsJob))
    entries.append((Kernel("sort.cu", "scatter<uint16>"), ScatterJob))
    return entries


def _steps(number: str) -> list[Entry]:
    return [
        (Kernel("ssim.cu", f"ssim<{number}>"), SsimJob),
        (Kernel("ssim.cu", f"add_losses<{number}>"), LossesJob),
        (Kernel("ssim.cu", f"ssim_backward<{number}>"), SsimBackwardJob),
        (Kernel("adam.cu", f"begin_adam<{number}>"), BeginAdamJob),
        (Kernel("adam.cu", f"adam<{number}>"), AdamJob),
        (Kernel("adam.cu", f"adam_rows<{number}>"), AdamJob),
        (Kernel("finite.cu", f"check_finite<{number}>"), FiniteJob),
    ]
