"""Regions: parts of a tree that have every level, and the files that hold them level by level."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.errors import ConfigError
from gsfw.lod.nodes import Tree

FIRST_SIGHT = 16_384
"""Most Gaussians of the coarsest level, which viewers load first: about half a megabyte."""


@dataclass(frozen=True)
class Regions:
    """A tree cut into regions and levels. Level 0 is the finest; the next have half the nodes."""

    tree: Tree
    levels: int
    """Number of levels."""
    bits: int
    """A region has 2^bits Gaussians of the model; the last one may have fewer."""
    chunk: int
    """Most nodes of a file, unless one region has more."""

    @staticmethod
    def of(tree: Tree, levels: int, region: int, chunk: int) -> Regions:
        """Cut a tree.

        Args:
            tree: the tree.
            levels: their number; 0 for as many as leave ``FIRST_SIGHT`` nodes.
            region: most Gaussians of a region.
            chunk: most nodes of a file.

        Raises:
            ConfigError: the tree or a region has too few Gaussians for the levels.
        """
        depth, bits = len(tree.sizes) - 1, region.bit_length() - 1
        most = 1 + min(depth, bits)
        if levels > most:
            is_region = bits < depth
            given = f"regions of {region:,}" if is_region else f"a scene of {tree.count:,}"
            larger = f", or format.region={2 ** (levels - 1)} or more" if is_region else ""
            raise ConfigError(
                f"format.num_levels={levels}: {given} Gaussians cannot be halved so often.",
                f"Give format.num_levels={most} or fewer{larger}.",
            )
        wanted = 1 + sum(size > FIRST_SIGHT for size in tree.sizes)
        return Regions(tree, levels or min(wanted, most), min(bits, depth), chunk)

    @property
    def count(self) -> int:
        """Number of regions."""
        return self.tree.sizes[self.depth]

    @property
    def depth(self) -> int:
        """Level of the tree, from the root on, whose nodes are the regions."""
        return len(self.tree.sizes) - 1 - self.bits

    def size(self, level: int) -> int:
        """Number of nodes of a level."""
        return self.tree.sizes[-1 - level]

    def width(self, level: int) -> int:
        """Nodes that a region has in a level; the last one may have fewer."""
        return 1 << (self.bits - level)

    def files(self, level: int) -> list[range]:
        """The regions of each file of a level: neighbours in space."""
        each = max(1, self.chunk // self.width(level))
        return [range(first, min(first + each, self.count)) for first in range(0, self.count, each)]

    def nodes(self, level: int, regions: range) -> range:
        """Numbers of the nodes that neighbouring regions have in a level."""
        start, width = self.tree.starts[-1 - level], self.width(level)
        end = min(regions.stop * width, self.size(level))
        return range(start + regions.start * width, start + end)
