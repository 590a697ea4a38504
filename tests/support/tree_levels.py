"""Levels of a tree of detail, as splats."""

from dataclasses import replace

import torch

from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Splats
from gsfw.lod.exporter import tree_of
from gsfw.lod.importer import world_from_tree


def nodes(content: SplatFile, level: int) -> Splats:
    """The nodes of a level of the tree over splats, in their world; level 0 is the finest."""
    tree, header = tree_of(content)
    first, size = tree.starts[-1 - level], tree.sizes[-1 - level]
    found = tree.nodes(torch.arange(first, first + size)).splats()
    return replace(found, means=world_from_tree(header).apply(found.means))
