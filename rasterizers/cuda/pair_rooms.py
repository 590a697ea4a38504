"""Pair rooms: memory for pairs in a CUDA graph, where the host cannot ask for their number."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsfw.kernels.cuda.arrays import capacity

MARGIN = 1.5
"""Room, as a multiple of the most pairs that an image of the size has had: views differ."""


class PairRooms:
    """The numbers of pairs that images have had, and that those of the next CUDA graph may have.

    A captured image with more pairs than it has room for is wrong, but writes nowhere else;
    ``fits`` tells, on the device. What it would have needed is kept there for ``make_room``.
    """

    def __init__(self) -> None:
        self._most: dict[tuple[int, int], int] = {}
        self._needed: Int[Tensor, ""] | None = None
        """On the device: most pairs that any captured image has had; its address never changes."""
        self._fitting: list[Tensor] = []

    def seen(self, size: tuple[int, int], count: int, device: torch.device) -> None:
        """Note the pairs of an image of ``size``, which the host has read."""
        if self._needed is None:  # Before any capture, whose memory ends with its graph.
            self._needed = torch.zeros((), dtype=torch.int64, device=device)
        self._most[size] = max(self._most.get(size, 0), count)

    def room(self, size: tuple[int, int]) -> int:
        """Pairs that an image of this size gets room for."""
        return capacity(int(MARGIN * max(self._most.get(size, 0), 1)))

    def captured(self, count: Int[Tensor, ""], room: int) -> None:
        """Note a captured image, whose number of pairs only the device knows."""
        assert self._needed is not None, "an image is captured after others were rendered"
        torch.maximum(self._needed, count, out=self._needed)
        self._fitting.append(count <= room)

    def fits(self) -> Bool[Tensor, ""] | None:
        """True on the device if all captured images since the last call had room."""
        found, self._fitting = self._fitting, []
        return torch.stack(found).all() if found else None

    def make_room(self) -> None:
        """Take what captured images have needed as the most of every size; waits for the device."""
        if self._needed is not None:
            needed = int(self._needed)
            self._most = {size: max(most, needed) for size, most in self._most.items()}
