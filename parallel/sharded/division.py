"""Division: which rows of a model, and which bands of an image, a process has.

Rows and images have a fixed number of shards, whatever the number of processes: sums go over the
shards in their order, so that any number of processes computes the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass

TILE = 16
"""Bands begin at multiples of this many pixels: rasterizers blend tiles of 16 x 16."""


@dataclass(frozen=True)
class Division:
    """Shards of rows and images, and the processes that have them."""

    shards: int
    """Shards of the rows, and at most as many bands of an image."""
    size: int
    """Number of processes, at most ``shards``."""

    def first_shard(self, rank: int) -> int:
        """The first shard of a process, which has successive ones; ``shards`` beyond the last."""
        return rank * self.shards // self.size

    def shards_of(self, rank: int) -> range:
        """The shards of a process."""
        return range(self.first_shard(rank), self.first_shard(rank + 1))

    def start(self, shard: int, rows: int) -> int:
        """The first row of a shard, of all ``rows``; shards differ by one row at most."""
        return shard * rows // self.shards

    def rows_of(self, rank: int, rows: int) -> range:
        """The rows of a process, of all ``rows``."""
        first, last = self.first_shard(rank), self.first_shard(rank + 1)
        return range(self.start(first, rows), self.start(last, rows))

    def lengths(self, rank: int, rows: int) -> list[int]:
        """Number of rows of each shard of a process, of all ``rows``."""
        return [
            self.start(shard + 1, rows) - self.start(shard, rows) for shard in self.shards_of(rank)
        ]

    def band_height(self, height: int) -> int:
        """Height of the bands of an image, in pixels, but for the last one."""
        return TILE * -(-height // (TILE * self.shards))

    def bands(self, height: int) -> list[range]:
        """The rows of pixels of each band of an image."""
        step = self.band_height(height)
        return [range(top, min(top + step, height)) for top in range(0, height, step)]

    def owner(self, image: int, band: int) -> int:
        """The process that renders a band of an image of a step.

        Neighbours are about as expensive, and so is the same band of other images.
        """
        return (image + band) % self.size
