"""Arrays: memory for several arrays that kernels know by address, allocated at once."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

ALIGNMENT = 256
"""Each array begins at a multiple of so many bytes, as torch's own do at least."""

STEPS_PER_OCTAVE = 8
"""Sizes that ``capacity`` has between a power of two and the next one."""


class Arrays:
    """Arrays by name. An allocation of its own for each would cost the host as much as a launch."""

    def __init__(self, device: torch.device, sizes: Mapping[str, tuple[int, torch.dtype]]) -> None:
        """Allocate.

        Args:
            device: where.
            sizes: number of elements and type of each array.
        """
        self.device = device
        self._sizes = sizes
        self._begins: dict[str, int] = {}
        end = 0
        for name, (count, dtype) in sizes.items():
            self._begins[name] = end
            end += -(-count * dtype.itemsize // ALIGNMENT) * ALIGNMENT
        self._memory = torch.empty(end, dtype=torch.uint8, device=device)
        self._address = self._memory.data_ptr()

    def address(self, name: str) -> int | None:
        """The address of an array; ``None`` if it is not there."""
        begin = self._begins.get(name)
        return None if begin is None else self._address + begin

    def tensor(self, name: str) -> Tensor:
        """An array as a tensor."""
        (count, dtype), begin = self._sizes[name], self._begins[name]
        return self._memory[begin : begin + count * dtype.itemsize].view(dtype)


def capacity(count: int) -> int:
    """The next size at or above ``count`` out of eight per octave.

    Numbers that differ from image to image would else ask torch's allocator for blocks of ever new
    sizes, which it splits and cannot join again.
    """
    step = 1 << max(0, (max(count, 1) - 1).bit_length() - STEPS_PER_OCTAVE.bit_length())
    return -(-count // step) * step
