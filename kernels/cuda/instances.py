"""Instances: which instance of each kernel's template renders an image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import torch

from gsfw.kernels.cuda.launcher import Kernel

WIDTHS = (1, 2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 40)
"""Numbers of channels that blending is compiled for; others get further channels of 0."""

CHUNKS = {
    torch.float32: {4: (128, 64), 8: (128, 32), 24: (64, 32), 40: (32, 32)},
    torch.float64: {8: (64, 32), 40: (32, 32)},
}
"""Splats of a tile between two checkpoints, and the threads that share them in the backward pass
(32 or 64), by the most channels that they are for. What a block shares must fit into 48 KB.

With fewer splats, or more threads, more warps fit on a multiprocessor; with fewer splats there are
more checkpoints. On an H200 a step of RGB takes, with (128, 32), (64, 32), (128, 64) and (64, 64),
0.586, 0.561, 0.535 and 0.534 ms on the workload "garden", and 2.77, 2.80, 2.70 and 2.81 ms with a
million splats. A benchmark may replace an entry before its first image.
"""

HASH_WIDTHS = (4, 2, 1)
"""Channels of a hash grid's table that a thread may have; the first that divides them is taken."""

NAMES = {torch.float32: "float", torch.float64: "double"}
"""Names of number types in C++."""

KEYS = {torch.int16: "uint16", torch.int32: "uint32", torch.int64: "uint64"}
"""Types of keys in C++; torch keeps them in signed integers of the same size."""


@dataclass(frozen=True)
class Instances:
    """The kernels of one image, each made when it is first asked for; see ``instances``."""

    dtype: torch.dtype
    covariances: bool
    """True if splats have covariances instead of quaternions and scales."""
    sh_degree: int
    """-1 for plain channels."""
    channels: int
    tile_key: torch.dtype
    ragged: bool = False
    """True if each splat has spherical harmonics of its own degree."""

    @cached_property
    def width(self) -> int:
        """Channels that blending is compiled for."""
        return next(width for width in WIDTHS if width >= self.channels)

    @property
    def chunk(self) -> int:
        """Splats of a tile between two checkpoints."""
        return self._chunk()[0]

    @property
    def chunk_threads(self) -> int:
        """Threads that share a chunk in the backward pass."""
        return self._chunk()[1]

    @cached_property
    def project(self) -> Kernel:
        """From splats to projected splats."""
        return Kernel("project.cu", f"project<{self._projected()}>")

    def project_backward(self, pose: bool) -> Kernel:
        """From sums to gradients of the splats and, if wanted, of the pose."""
        return self._project_backward[pose]

    @cached_property
    def _project_backward(self) -> tuple[Kernel, Kernel]:
        return _both("project_backward", self._projected())

    @cached_property
    def sum_counts(self) -> Kernel:
        """The kernel that sums tile counts from front to back."""
        return Kernel("bin.cu", "sum_counts<int>")

    @cached_property
    def emit(self) -> Kernel:
        """From projected splats to pairs of a splat and a tile."""
        return Kernel("bin.cu", f"emit<{NAMES[self.dtype]}, {KEYS[self.tile_key]}>")

    @cached_property
    def find_tiles(self) -> Kernel:
        """The kernel that finds the first sorted pair of each tile."""
        return Kernel("bin.cu", f"find_tiles<{KEYS[self.tile_key]}>")

    def blend(self, measure: bool) -> Kernel:
        """From pairs to an image, with or without each splat's contribution."""
        return self._blend[measure]

    @cached_property
    def _blend(self) -> tuple[Kernel, Kernel]:
        return _both("blend", self._blended())

    def blend_backward(self, absolute: bool) -> Kernel:
        """From an image's gradient to sums, with or without magnitudes."""
        return self._blend_backward[absolute]

    @cached_property
    def _blend_backward(self) -> tuple[Kernel, Kernel]:
        return _both("blend_backward", f"{self._blended()}, {self.chunk_threads}")

    def _chunk(self) -> tuple[int, int]:
        chunks = CHUNKS[self.dtype]
        return chunks[next(widest for widest in chunks if widest >= self.width)]

    def _projected(self) -> str:
        name = NAMES[self.dtype]
        shape = f"Symmetric3<{name}>" if self.covariances else f"Axes<{name}>"
        return f"{name}, {shape}, {self.sh_degree}, {_bool(self.ragged)}"

    def _blended(self) -> str:
        return f"{NAMES[self.dtype]}, {self.width}, {self.chunk}"


def _both(name: str, arguments: str) -> tuple[Kernel, Kernel]:
    """The instances of a template without and with what its last argument asks for."""
    off, on = (
        Kernel(f"{name}.cu", f"{name}<{arguments}, {_bool(last)}>") for last in (False, True)
    )
    return off, on


def _bool(value: bool) -> str:
    return "true" if value else "false"


@cache
def instances(
    dtype: torch.dtype,
    covariances: bool,
    sh_degree: int,
    channels: int,
    tile_key: torch.dtype,
    ragged: bool = False,
) -> Instances:
    """The kernels of images of one kind, always the same object."""
    return Instances(dtype, covariances, sh_degree, channels, tile_key, ragged)


@cache
def kernel_of(source: str, name: str, dtype: torch.dtype, *constants: int) -> Kernel:
    """The instance of a template for a number type, and for constants if it has any."""
    return Kernel(source, f"{name}<{', '.join([NAMES[dtype], *map(str, constants)])}>")
