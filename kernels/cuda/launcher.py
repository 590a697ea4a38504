"""Launcher: runs kernels on the memory of tensors, wherever that is."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Kernel:
    """One instance of a kernel's template."""

    source: str
    """File in kernels/cuda/sources, such as "blend.cu"."""
    expression: str
    """As C++ spells it inside namespace gsfw::cuda, such as "blend<float, 3, 128, false>"."""


Entry = tuple[Kernel, type[ctypes.Structure]]
"""A kernel, and the job that it takes."""


class Launcher(ABC):
    """Compiles kernels when they are first asked for, and runs them.

    Every kernel takes one structure by value, which ``gsfw.kernels.cuda.jobs`` mirrors.
    """

    def reaches(self, device: torch.device) -> bool:
        """True if kernels may be given memory of this device."""
        return True

    def captures(self) -> bool:
        """True if launches are recorded into a CUDA graph, so that the host can read no result."""
        return False

    def prepare(self, kernels: Sequence[Entry]) -> None:  # noqa: B027
        """Compile what will be launched soon, all at once; may leave it to the launches."""

    @abstractmethod
    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        """Start ``blocks`` blocks of ``threads`` threads; does not wait for them to end.

        Nothing is started where ``blocks`` is 0.

        Raises:
            CudaError: the kernel does not compile, does not load, or cannot be started.
        """


def address(tensor: Tensor | None) -> int | None:
    """Address of a tensor's memory; ``None`` if there is no tensor. A job does not keep it alive.

    Raises:
        ValueError: the tensor is not contiguous.
    """
    if tensor is None:
        return None
    if not tensor.is_contiguous():
        raise ValueError(f"expected a contiguous tensor, found strides {tensor.stride()}")
    return tensor.data_ptr()


def blocks_for(count: int, per_block: int) -> int:
    """Blocks that together answer for ``count`` elements."""
    return -(-count // per_block)
