"""Block data: the data set of a partition, or one of its blocks, read from where it lies.

Each block gets the scene frame of its own cameras, a float64 similarity: the float32 numbers of its
training are as small as those of any small scene, however far from the origin of the world it is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from gsfw.core.config import DataManagerConfig, Detection
from gsfw.core.datamanager import DataManager, DataRequest, Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.reading import is_there
from gsfw.core.ranges import check_ranges, number
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording, Sightings, data_path
from gsfw.partition.document import FILE, Block, Partition, read_partition
from gsfw.partition.ground import Ground
from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed

SHOWN = 3
"""Names of views in a message."""


@dataclass
class BlocksConfig(DataManagerConfig):
    """Settings of the data of a partition; those of its format are in partition.json."""

    block: str = ""
    """Name of the block. Empty: the whole data set, with the views that the partition holds out."""
    source: str = ""
    """Place of the data set. Empty: where it was when the partition was made."""
    points: int = number(0, at_least=0)
    """Most points to start from, evenly chosen; 0: all."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A partition.json, or its folder."""
        recognised = path.name == FILE or (path / FILE).is_file()
        return Detection(recognised, FILE, FILE if recognised else "", priority=30)

    def build(self, request: DataRequest) -> DataManager:
        """Open the data set with the views and points of the block.

        Raises:
            DataError: the partition is damaged, or the data set has moved or changed.
        """
        partition = read_partition(data_path(request.path))
        block = partition.block(self.block) if self.block else None
        source = self._source(partition)
        kind = source_config(partition)
        recording = kind.recording(source, request.downscale)
        recording = _with_split(recording, partition)
        if block is not None:
            recording = _of_block(recording, partition, block)
        recording = _with_fewer_points(recording, self.points)
        remaining = max(1.0, request.downscale / recording.shrunk)
        plain = replace(request, downscale=remaining, eval_names=(), eval_every_nth=0)
        rules = kind.lens_rule(), kind.mask_rule(), kind.map_folders(), kind.as_stored()
        return Capture(recording, plain, *rules)

    def _source(self, partition: Partition) -> Path:
        source = Path(self.source) if self.source else partition.data
        if not is_there(source):
            raise DataError(
                f"{partition.path} is of the data set {source}, and there is no such file or "
                "folder.",
                "Say where it is now: datamanager.source=PATH (gsfw blocks: source=PATH).",
            )
        return source


def source_config(partition: Partition) -> CaptureConfig:
    """The settings of the format of the data set.

    Raises:
        ConfigError: the format is not installed, or is none of images by cameras; a number is out
            of range.
        DataError: a setting is of another type.
    """
    spec = installed().find("datamanager", partition.datamanager)
    config = check_source(load("datamanager", spec)(), partition.datamanager)
    known = {item.name: getattr(config, item.name) for item in fields(config)}
    values: dict[str, Any] = {}
    for name, value in partition.settings.items():
        found = tuple(value) if isinstance(value, list) else value
        if name not in known or not _is_alike(found, known[name]):
            raise DataError(
                f"{partition.path}: settings.{name} of its content is no setting of the format "
                f"{partition.datamanager}.",
                "Make it anew: gsfw partition DATA out=DIR with another folder.",
            )
        values[name] = found
    chosen = replace(config, **values)
    check_ranges(chosen, f"{partition.path}: settings.")
    return chosen


def check_source(config: object, name: str) -> CaptureConfig:
    """Check that a format gives frames, of which a block can have some.

    Raises:
        ConfigError: it is none.
    """
    if isinstance(config, CaptureConfig):
        return config
    raise ConfigError(
        f"datamanager {name} cannot be cut into blocks: it is no format of images on disk.",
        "Give a data set of COLMAP, transforms.json or another format of gsfw plugins.",
    )


def changed_settings(config: CaptureConfig) -> Mapping[str, Any]:
    """The settings of a format that differ from their defaults, as plain data."""
    usual = type(config)()
    found = {item.name: getattr(config, item.name) for item in fields(config)}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in found.items()
        if value != getattr(usual, name)
    }


def _is_alike(value: object, usual: object) -> bool:
    if isinstance(usual, bool) or isinstance(value, bool):
        return isinstance(usual, bool) and isinstance(value, bool)
    if isinstance(usual, int | float):
        return isinstance(value, int | float)
    return isinstance(value, type(usual))


def _with_split(recording: Recording, partition: Partition) -> Recording:
    """The recording with the split of the partition."""
    held = set(partition.held_out)
    frames = tuple(
        replace(frame, split=Split.EVAL if frame.name in held else Split.TRAIN)
        for frame in recording.frames
    )
    known = {frame.name for frame in frames}
    named = [name for block in partition.blocks for name in (*block.train, *block.evaluation)]
    _check_names([*partition.held_out, *named], known, partition)
    return replace(recording, frames=frames, split_origin=partition.held_out_by)


def _check_names(names: Sequence[str], known: Collection[str], partition: Partition) -> None:
    missing = sorted(set(names) - set(known))
    if missing:
        shown = ", ".join(missing[:SHOWN]) + (", ..." if len(missing) > SHOWN else "")
        raise DataError(
            f"{partition.path}: the data set {partition.data} has changed: {len(missing)} of its "
            f"views are gone ({shown}).",
            "Put them back, or make the partition anew: gsfw partition.",
        )


def _of_block(recording: Recording, partition: Partition, block: Block) -> Recording:
    """The recording with the frames and points of a block."""
    names = {*block.train, *block.evaluation}
    kept = [place for place, frame in enumerate(recording.frames) if frame.name in names]
    frames: tuple[Frame, ...] = tuple(recording.frames[place] for place in kept)
    places = places_of(recording.points, partition.ground)
    inside = block.cell.holds(places, block.margin)
    return _with_rows(
        replace(recording, frames=frames, name=f"{recording.name}-{block.name}"),
        inside.nonzero()[0],
    )


def _with_fewer_points(recording: Recording, most: int) -> Recording:
    count = len(recording.points)
    if not 0 < most < count:
        return recording
    return _with_rows(recording, rows_of(count, most))


def rows_of(count: int, most: int) -> Int64[np.ndarray, " r"]:
    """Rows of the points under ``points=most``."""
    return np.arange(count) if not 0 < most < count else np.arange(most) * count // most


def places_of(points: Float64[Tensor, "p 3"], ground: Ground) -> Float64[np.ndarray, "p 2"]:
    """Places of points of the world on the ground."""
    return ground.places(points.numpy())


def _with_rows(recording: Recording, rows: np.ndarray) -> Recording:
    """The recording with some of its points."""
    chosen = torch.from_numpy(rows)
    times = recording.point_times
    return replace(
        recording,
        points=recording.points[chosen],
        point_colors=recording.point_colors[chosen],
        point_times=None if times is None else times[chosen],
        sightings=Sightings.none,  # Their rows would be others.
    )
