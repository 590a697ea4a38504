"""Reader of COLMAP's binary models: little-endian records, every length checked before use."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8

from gsfw.datamanagers.colmap.model import CAMERA_MODELS, ColmapCamera, ColmapImage, Tracks, damaged

POINT = np.dtype([("id", "<u8"), ("xyz", "<f8", 3), ("rgb", "u1", 3), ("error", "<f8")])
"""The fixed part of a point; the length of its track and the track itself follow."""
OBSERVATION_BYTES = 24
"""Bytes of an observation of an image: x, y, and the number of a point."""
TRACK_ELEMENT = np.dtype([("image", "<u4"), ("observation", "<u4")])


class _Records:
    """The bytes of a file and how far they have been read."""

    def __init__(self, file: Path, noun: str) -> None:
        self.file = file
        self.content = file.read_bytes()
        self.position = 0
        self._noun = noun
        self._current = "its count"
        (self.count,) = self.take("<Q")

    def __iter__(self) -> Iterator[int]:
        for number in range(1, self.count + 1):
            self._current = f"{self._noun} {number} of {self.count}"
            yield number

    def take(self, layout: str) -> tuple[Any, ...]:
        """The next values of a struct layout."""
        start = self.position
        self.skip(struct.calcsize(layout))
        return struct.unpack_from(layout, self.content, start)

    def skip(self, length: int) -> None:
        """Move on, within the file."""
        self.position += length
        if self.position > len(self.content):
            raise damaged(self.file, f"its {len(self.content)} bytes end within {self._current}")

    def text(self) -> str:
        """The next string, up to its zero byte."""
        end = self.content.find(b"\0", self.position)
        start = self.position
        self.skip((len(self.content) if end < 0 else end) + 1 - start)
        return self.content[start:end].decode("utf-8", "replace")


def read_cameras(file: Path) -> dict[int, ColmapCamera]:
    """Cameras by their number.

    Raises:
        DataError: the file is cut off or damaged.
    """
    cameras: dict[int, ColmapCamera] = {}
    records = _Records(file, "camera")
    for _ in records:
        identifier, model, width, height = records.take("<iiQQ")
        if not 0 <= model < len(CAMERA_MODELS):
            raise damaged(file, f"camera {identifier} has the unknown model number {model}")
        name, parameters = CAMERA_MODELS[model]
        cameras[identifier] = ColmapCamera(name, width, height, records.take(f"<{parameters}d"))
    return cameras


def read_images(file: Path) -> list[ColmapImage]:
    """Registered images.

    Raises:
        DataError: the file is cut off or damaged.
    """
    images = []
    records = _Records(file, "image")
    for _ in records:
        identifier, *pose, camera = records.take("<i7di")
        name = records.text()
        (observations,) = records.take("<Q")
        records.skip(observations * OBSERVATION_BYTES)
        images.append(ColmapImage(name, camera, tuple(pose[:4]), tuple(pose[4:]), identifier))
    return images


def read_points(file: Path) -> tuple[Float64[np.ndarray, "p 3"], UInt8[np.ndarray, "p 3"]]:
    """Positions and colours of the points.

    Raises:
        DataError: the file is cut off or damaged.
    """
    points, _ = _points(file)
    return points["xyz"].astype(np.float64), points["rgb"].copy()


def read_tracks(file: Path) -> Tracks:
    """The images that show each point, and the points' reprojection errors.

    Raises:
        DataError: the file is cut off or damaged.
    """
    points, tracks = _points(file)
    lengths = np.array([len(track) for track in tracks], np.int64) // TRACK_ELEMENT.itemsize
    images = np.frombuffer(b"".join(tracks), TRACK_ELEMENT)["image"].astype(np.int64)
    return Tracks(images, lengths, points["error"].astype(np.float64))


def _points(file: Path) -> tuple[np.ndarray, list[bytes]]:
    """The fixed part of every point, and the bytes of its track."""
    records = _Records(file, "point")
    starts, tracks = [], []
    for _ in records:
        starts.append(records.position)
        records.skip(POINT.itemsize)
        (elements,) = records.take("<Q")
        start = records.position
        records.skip(elements * TRACK_ELEMENT.itemsize)
        tracks.append(records.content[start : records.position])
    content = np.frombuffer(records.content, np.uint8)
    rows = content[np.array(starts, np.int64)[:, None] + np.arange(POINT.itemsize)]
    return rows.view(POINT)[:, 0], tracks
