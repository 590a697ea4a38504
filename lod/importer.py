"""Importer: the finest level of a tree of levels of detail, as splats."""

from __future__ import annotations

from pathlib import Path

import torch

from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Splats
from gsfw.lod.file import Header, TreeFile, is_tree

MEMORY = 1 << 20
"""Bytes of chunks that are kept while all are read once."""


class LodImporter(Importer):
    """Reads ``.lod``."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True if the file begins as a tree does."""
        return is_tree(path)

    def read(self, path: Path) -> SplatFile:
        """Read the Gaussians of the model, in the order of the tree.

        Raises:
            DataError: the file is damaged.
        """
        tree = TreeFile(path, MEMORY)
        leaves = torch.arange(tree.starts[-1], tree.num_nodes)
        splats = tree.nodes(leaves).splats()
        return splat_file(transform_splats(splats, world_from_tree(tree.header)), tree.header)


def world_from_tree(header: Header) -> Similarity:
    """Leads from the frame of a tree to the world of the data."""
    return Similarity(translation=torch.tensor(header.origin, dtype=torch.float64))


def splat_file(splats: Splats, header: Header) -> SplatFile:
    """Some splats of a tree as the content of a file."""
    return SplatFile(splats, header.antialiased, header.up)
