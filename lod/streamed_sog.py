"""Streamed SOG of PlayCanvas: the levels of a tree as SOG files by region, for browsers.

https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/streamed-sog/, version 1. An
index has a binary tree of boxes. Each of its leaves is a region, and names for every level the file
and the rows in it. The frame is that of the PLY that was converted, as for SOG. Facts that the page
does not state are from what splat-transform 3.7.0 (PlayCanvas, MIT) writes and reads.
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import ConfigError, OutputError
from gsfw.core.exchange import Exporter, ExportSource, SplatFile
from gsfw.core.files.atomic import PLACE, folder_or_nothing, write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.one_thread import one_thread
from gsfw.core.progress import tracked
from gsfw.core.ranges import number
from gsfw.core.splats import Splats
from gsfw.formats.sog.container import META
from gsfw.formats.sog.description import MAX_PALETTE
from gsfw.formats.sog.exporter import sog_files
from gsfw.formats.sog.sh_palette import MAX_DEGREE
from gsfw.lod.exporter import tree_of
from gsfw.lod.file import Header
from gsfw.lod.importer import splat_file, world_from_tree
from gsfw.lod.regions import Regions

INDEX = "lod-meta.json"
"""Name by which viewers know the format."""
FOLDER = re.compile(r"\d+_\d+")
"""Name of the folder of a file: its level, and its number."""
AT_ONCE = 8
"""Most files that are written at a time: each takes 0.3 GB at degree 3, in its usual size."""
OWN = re.compile(
    rf"{re.escape(INDEX)}|{FOLDER.pattern}(/({re.escape(META)}|\w+\.webp))?|(.*/)?\..*"
)
"""Paths in a folder that a later export may replace, and hidden files."""


@dataclass(frozen=True)
class StreamedSogExporter(Exporter):
    """Writes a folder: ``lod-meta.json``, and a folder of SOG images for each file."""

    num_levels: int = number(0, at_least=0)
    """Number of levels. Each has half the Gaussians of the one before. 0: halved until at most
    16,384 are left."""
    region: int = number(8192, at_least=1)
    """Most Gaussians of a region, in which a viewer chooses one level; rounded down to a power of
    two. Smaller regions follow the camera more closely, and take viewers more time."""
    chunk: int = number(131_072, at_least=1)
    """Most Gaussians of a file, the least that a viewer loads, unless a region has more."""
    sharing: int = number(8, at_least=1)
    """Gaussians for each vector of SH coefficients, which the Gaussians of a file share. Larger
    numbers make files smaller, smaller ones keep the colours."""

    suffix = ""
    is_folder = True
    most_sh_degree = MAX_DEGREE

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the folder; an earlier export in it is replaced, and the index comes last.

        SH bands above degree 3 are left out. An error leaves no new folder.

        Raises:
            OutputError: a file cannot be written, or the folder has files of other kinds.
            ConfigError: there are too few splats for the levels.
            ValueError: there are no splats, or a value is not finite, or out of range.
        """
        tree, header = tree_of(source.splat_file())
        regions = Regions.of(tree, self.num_levels, self.region, self.chunk)
        _check_folder(path)
        with folder_or_nothing(path):
            (path / INDEX).unlink(missing_ok=True)
            index = self._write_files(path, regions, header)
            write_atomically(path / INDEX, json_text(index.document()).encode())
            self._remove_older(path, {Path(file).parent.name for file in index.files})

    def _write_files(self, path: Path, regions: Regions, header: Header) -> _Index:
        """Write the files of all levels, several at a time; return the index of them."""
        files = [
            (level, place, part)
            for level in range(regions.levels)
            for place, part in enumerate(regions.files(level))
        ]

        def write(level: int, place: int, part: range) -> Boxes:
            with one_thread():
                splats = _splats(regions, header, level, part)
                self._write_file(path / f"{level}_{place}", splat_file(splats, header))
                return _boxes(regions, level, part, splats)

        index = _Index(regions)
        with (
            one_thread() as count,
            ThreadPoolExecutor(min(count, AT_ONCE), "gsfw-streamed-sog") as threads,
        ):
            written = threads.map(write, *zip(*files, strict=True))
            written = tracked(written, "writing levels of detail", len(files))
            for (level, place, part), boxes in zip(files, written, strict=True):
                index.add(f"{level}_{place}/{META}", level, part, boxes)
        return index

    @staticmethod
    def _remove_older(path: Path, names: set[str]) -> None:
        """Remove the files of an earlier export that are not among those of this one."""
        for item in path.iterdir():
            if FOLDER.fullmatch(item.name) and item.name not in names:
                rmtree(item, ignore_errors=True)

    def _write_file(self, folder: Path, content: SplatFile) -> None:
        """Write a SOG as a folder, its rows in the order of the tree."""
        count = len(content.splats)
        palette = min(-(-count // self.sharing), MAX_PALETTE)
        for name, text in sog_files(content, palette, torch.arange(count)).items():
            write_atomically(folder / name, text)


def _check_folder(path: Path) -> None:
    """Check that nothing but an earlier export can be replaced.

    Raises:
        ConfigError: the index is given in place of its folder.
        OutputError: the folder has other files.
    """
    if path.name == INDEX:
        raise ConfigError(f"{path} is the index of a folder.", f"Give the folder: {path.parent}")
    names = sorted(item.relative_to(path).as_posix() for item in path.rglob("*"))
    others = [name for name in names if not OWN.fullmatch(name)]
    if others:
        raise OutputError(
            f"{path} has files of other kinds, such as {others[0]}: a streamed SOG is a folder of "
            "its own.",
            f"Choose {PLACE}: a new or an empty folder.",
        )


def _splats(regions: Regions, header: Header, level: int, part: range) -> Splats:
    """The splats of a file, in the world of the data."""
    numbers = regions.nodes(level, part)
    nodes = regions.tree.nodes(torch.arange(numbers.start, numbers.stop))
    return transform_splats(nodes.splats(), world_from_tree(header))


Boxes = tuple[Float64[np.ndarray, "r 3"], Float64[np.ndarray, "r 3"]]
"""Lower and upper corners of the boxes of some regions in a level."""


def _boxes(regions: Regions, level: int, part: range, splats: Splats) -> Boxes:
    """The boxes of the regions of a file."""
    first = regions.nodes(level, part).start
    starts = [regions.nodes(level, range(each, each + 1)).start - first for each in part]
    means, seen = splats.means.numpy(), _halves(splats)
    low, high = (
        np.minimum.reduceat(means - seen, starts),
        np.maximum.reduceat(means + seen, starts),
    )
    return low, high


@dataclass
class _Index:
    """The index, as files are added to it."""

    regions: Regions
    files: list[str] = field(default_factory=list)
    """Paths of the descriptions of all files."""

    def __post_init__(self) -> None:
        count = self.regions.count
        self._low, self._high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        self._lods: list[dict[str, dict[str, int]]] = [{} for _ in range(count)]

    def add(self, file: str, level: int, part: range, boxes: Boxes) -> None:
        """Add a file that has the splats of some regions in a level."""
        first = self.regions.nodes(level, part).start
        for region in part:
            rows = self.regions.nodes(level, range(region, region + 1))
            self._lods[region][str(level)] = {
                "file": len(self.files),
                "offset": rows.start - first,
                "count": len(rows),
            }
        self.files.append(file)
        places, (low, high) = slice(part.start, part.stop), boxes
        self._low[places] = np.minimum(self._low[places], low)
        self._high[places] = np.maximum(self._high[places], high)

    def document(self) -> dict[str, Any]:
        """The document."""
        regions = self.regions
        counts = [regions.size(level) for level in range(regions.levels)]
        return {
            "version": 1,
            "asset": {"generator": f"gsfw {version('gsfw')}"},
            "count": sum(counts),
            "counts": counts,
            "lodLevels": regions.levels,
            "filenames": self.files,
            "tree": self._node(0, 0),
        }

    def _node(self, depth: int, place: int) -> dict[str, Any]:
        """A node of the tree and those below it."""
        last = self.regions.depth
        first, end = (each << (last - depth) for each in (place, place + 1))
        low, high = self._low[first:end].min(axis=0), self._high[first:end].max(axis=0)
        bound = {"min": _short(low), "max": _short(high)}
        if depth == last:
            return {"bound": bound, "lods": self._lods[place]}
        two = range(2 * place, min(2 * place + 2, self.regions.tree.sizes[depth + 1]))
        children = [self._node(depth + 1, each) for each in two]
        return {"bound": bound, "children": children} if len(children) > 1 else children[0]


def _short(values: Float64[np.ndarray, " 3"]) -> list[float]:
    """Numbers with the digits that float32 has."""
    return [float(f"{value:.9g}") for value in values]


def _halves(splats: Splats) -> Float64[np.ndarray, "n 3"]:
    """Half the sides of the boxes of splats, at one standard deviation, as splat-transform has."""
    assert splats.quats is not None
    assert splats.scales is not None
    sides: Tensor = unit_matrices(splats.quats).abs() * splats.scales[:, None]
    return sides.sum(dim=2).numpy()
