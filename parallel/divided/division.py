"""Division: which rows of a model, and which bands of an image, a process has.

Rows and images have a fixed number of parts, whatever the number of processes: sums go over the
parts in their order, so that any number of processes computes the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass

TILE = 16
"""Bands begin at multiples of this many pixels: rasterizers blend tiles of 16 x 16."""


@dataclass(frozen=True)
class Division:
    """Parts of rows and images, and the processes that have them."""

    parts: int
    """Parts of the rows, and at most as many bands of an image."""
    size: int
    """Number of processes, at most ``parts``."""

    def first_part(self, rank: int) -> int:
        """The first part of a process, which has successive ones; ``parts`` beyond the last."""
        return rank * self.parts // self.size

    def parts_of(self, rank: int) -> range:
        """The parts of a process."""
        return range(self.first_part(rank), self.first_part(rank + 1))

    def start(self, part: int, rows: int) -> int:
        """The first row of a part, of all ``rows``; parts differ by one row at most."""
        return part * rows // self.parts

    def rows_of(self, rank: int, rows: int) -> range:
        """The rows of a process, of all ``rows``."""
        first, last = self.first_part(rank), self.first_part(rank + 1)
        return range(self.start(first, rows), self.start(last, rows))

    def lengths(self, rank: int, rows: int) -> list[int]:
        """Number of rows of each part of a process, of all ``rows``."""
        return [self.start(part + 1, rows) - self.start(part, rows) for part in self.parts_of(rank)]

    def band_height(self, height: int) -> int:
        """Height of the bands of an image, in pixels, but for the last one."""
        return TILE * -(-height // (TILE * self.parts))

    def bands(self, height: int) -> list[range]:
        """The rows of pixels of each band of an image."""
        step = self.band_height(height)
        return [range(top, min(top + step, height)) for top in range(0, height, step)]

    def bands_of(self, rank: int, height: int) -> list[int]:
        """The bands of a process: every N-th, since neighbours are about as expensive."""
        return list(range(rank, len(self.bands(height)), self.size))
