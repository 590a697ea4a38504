"""Exporter: the splats of a model as a tree of levels of detail (``format=lod``)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gsfw.core.exchange import Exporter, ExportSource, SplatFile
from gsfw.core.one_thread import one_thread
from gsfw.lod.build import build
from gsfw.lod.file import Header, write_tree
from gsfw.lod.nodes import TreeInMemory


class LodExporter(Exporter):
    """Writes ``.lod``."""

    suffix = ".lod"

    def write(self, path: Path, source: ExportSource) -> None:
        """Build the tree in memory, and write it atomically.

        Raises:
            OutputError: it cannot be written.
            ValueError: there are no splats, or a value is not finite, or out of range.
        """
        write_tree(path, *tree_of(source.splat_file()))


@one_thread()
def tree_of(content: SplatFile) -> tuple[TreeInMemory, Header]:
    """The tree of a set of splats, in a frame around their median, and the facts about it.

    Raises:
        ValueError: there are no splats, or a value is not finite, or out of range.
    """
    splats = content.splats
    if not len(splats):
        raise ValueError("there are no splats to write")
    held = splats.held_by_float32()
    if not bool(held.all()):
        raise ValueError(f"row {int((~held).nonzero()[0])} has a value that is not finite")
    origin = splats.means.double().median(dim=0).values
    tree = build(replace(splats, means=splats.means - origin))
    if not bool(tree.all_nodes.sound().all() and tree.all_places.isfinite().all()):
        raise ValueError("there are opacities out of [0, 1], or splats too far out for float32")
    x, y, z = origin.tolist()
    return tree, Header(tree.count, tree.sh_degree, (x, y, z), content.antialiased, content.up)
