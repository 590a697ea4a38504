"""Document: partition.json, which says how a data set was cut; no image and no point is copied."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import json_text, parsed_json
from gsfw.core.files.reading import is_there
from gsfw.partition.cells import Cell
from gsfw.partition.ground import Ground

FILE = "partition.json"
"""Name of the file in the folder of a partition."""
FORMAT, VERSION = "gsfw partition", 1
ANEW = "Make it anew: gsfw partition DATA out=DIR with another folder."
SIDES = (("first_from", "first_to"), ("second_from", "second_to"))
"""Names of the ends of a cell along the axes of the ground; absent ones are at infinity."""


@dataclass(frozen=True)
class Block:
    """A part of a scene that is trained alone."""

    name: str
    """Name of its folder."""
    cell: Cell
    """Its own place: the merged model has its Gaussians there, and only there."""
    margin: float
    """Distance around the cell in which it has points and Gaussians of its own, too."""
    train: tuple[str, ...]
    """Names of the views that it is trained on."""
    evaluation: tuple[str, ...]
    """Names of the held-out views that it is measured on."""
    points: int
    """Points of the cell."""
    gaussians: int
    """Expected number of Gaussians."""
    memory_mb: float
    """Expected peak memory, in 1e6 bytes."""


@dataclass(frozen=True)
class Partition:
    """A data set and its blocks."""

    data: Path
    """The data set."""
    datamanager: str
    """Name of its format."""
    settings: Mapping[str, Any]
    """Settings of the format that differ from their defaults, as plain data."""
    ground: Ground
    held_out: tuple[str, ...]
    """Names of all held-out views: none of them is trained on in any block."""
    held_out_by: str
    """Rule that chose them."""
    blocks: tuple[Block, ...]
    path: Path = field(default_factory=Path)
    """The file that it was read from."""

    def block(self, name: str) -> Block:
        """The block of this name.

        Raises:
            DataError: there is none; names those that there are.
        """
        for block in self.blocks:
            if block.name == name:
                return block
        raise DataError(
            f"{self.path} has no block {name!r}.",
            f"Blocks: {', '.join(block.name for block in self.blocks)}.",
        )


def write_partition(folder: Path, partition: Partition) -> Path:
    """Write the file; its path.

    Raises:
        OutputError: it cannot be written.
    """
    ground = partition.ground
    document = {
        "format": FORMAT,
        "version": VERSION,
        "data": str(partition.data.resolve()),
        "data_from_here": os.path.relpath(partition.data.resolve(), folder.resolve()),
        "datamanager": partition.datamanager,
        "settings": dict(partition.settings),
        "ground": {"origin": ground.origin.tolist(), "axes": ground.axes.tolist()},
        "held_out_by": partition.held_out_by,
        "held_out": list(partition.held_out),
        "blocks": [_block_document(block) for block in partition.blocks],
    }
    path = folder / FILE
    write_atomically(path, (json_text(document, indent=1) + "\n").encode())
    return path


def _block_document(block: Block) -> dict[str, Any]:
    cell = block.cell
    ends = {
        name: value
        for axis, names in enumerate(SIDES)
        for name, value in zip(names, (cell.low[axis], cell.high[axis]), strict=True)
        if math.isfinite(value)
    }
    return {
        "name": block.name,
        "cell": ends,
        "margin": block.margin,
        "points": block.points,
        "gaussians": block.gaussians,
        "memory_mb": round(block.memory_mb, 1),
        "train": list(block.train),
        "eval": list(block.evaluation),
    }


def read_partition(path: Path) -> Partition:
    """Read the file of a partition, or that in a folder.

    Raises:
        DataError: it is missing, damaged, or of a newer gsfw; names the place.
    """
    path = path / FILE if path.is_dir() else path
    fields = JsonFields(path, "", _document(path), ANEW, "content")
    if fields.text("format") != FORMAT:
        raise fields.refuse("format", repr(FORMAT))
    if fields.count("version", 1) > VERSION:
        raise DataError(
            f"{path} is of version {fields.count('version')}, and this gsfw reads {VERSION}.",
            "Use a newer gsfw, or make it anew: gsfw partition.",
        )
    ground = fields.fields("ground")
    axes = ground.numbers("axes", 3, 3)
    if np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6:
        raise ground.refuse("axes", "three orthonormal vectors")
    blocks = tuple(_block(item) for item in fields.objects("blocks"))
    if not blocks or len({block.name for block in blocks}) < len(blocks):
        raise DataError(f"{path}: it has no blocks, or two of one name.", ANEW)
    data, from_here = Path(fields.text("data")), fields.text("data_from_here")
    try:
        beside = (path.parent / from_here).resolve()
    except (OSError, ValueError, RuntimeError):
        raise fields.refuse("data_from_here", "a path") from None
    return Partition(
        data=data if is_there(data) or not is_there(beside) else beside,
        datamanager=fields.text("datamanager"),
        settings=fields.fields("settings").values,
        ground=Ground(ground.numbers("origin", 3), axes),
        held_out=tuple(fields.texts("held_out")),
        held_out_by=fields.text("held_out_by"),
        blocks=blocks,
        path=path,
    )


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = parsed_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DataError(
            f"{path.parent} is no partition: it has no {path.name}.",
            "Make one: gsfw partition DATA out=DIR.",
        ) from None
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be read: {error}.", ANEW) from None
    if not isinstance(document, dict):
        raise DataError(f"{path}: expected an object, found {type(document).__name__}.", ANEW)
    return document


def _block(fields: JsonFields) -> Block:
    cell = fields.fields("cell")
    ends = [
        [float(cell.numbers(name)) if name in cell else unbounded for name in names]
        for names, unbounded in zip(zip(*SIDES, strict=True), (-math.inf, math.inf), strict=True)
    ]
    (first_low, second_low), (first_high, second_high) = ends
    if not (first_low < first_high and second_low < second_high):
        raise fields.refuse("cell", "ends in ascending order")
    name = fields.text("name")
    if not name or not name.replace("-", "").replace("_", "").isalnum():
        raise fields.refuse("name", "letters, digits, - and _")
    train = tuple(fields.texts("train"))
    if not train:
        raise fields.refuse("train", "the names of at least one view")
    return Block(
        name=name,
        cell=Cell((first_low, second_low), (first_high, second_high)),
        margin=float(fields.numbers("margin")),
        train=train,
        evaluation=tuple(fields.texts("eval")),
        points=fields.count("points"),
        gaussians=fields.count("gaussians"),
        memory_mb=float(fields.numbers("memory_mb")),
    )
