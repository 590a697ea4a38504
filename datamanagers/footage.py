"""Footage: what one camera has seen over time, as a video or a folder of pictures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.errors import DataError
from gsfw.datamanagers.pictures import EXTENSIONS, Header, read_header
from gsfw.datamanagers.video import Shot, Video, is_video

SAME_RATE = 1e-3
"""Rates of synchronised videos may differ by this part of them: files hold rounded ones."""


@dataclass(frozen=True)
class Footage:
    """The pictures of one camera, in order of time."""

    camera: str
    """Its name: that of the video without extension, or of the folder."""
    path: Path
    """The video, or the folder of the pictures."""
    video: Video | None
    """``None`` for a folder of pictures."""
    files: tuple[Path, ...] = ()
    """The pictures of the folder, in order; empty for a video."""

    @staticmethod
    def read(camera: str, path: Path) -> Footage:
        """Look at a video's packets, or at the names in a folder.

        Raises:
            DataError: the video is damaged or its rate varies, or the folder holds no pictures.
            UnavailableError: it is a video, and PyAV is not installed.
        """
        if is_video(path):
            video = Video.read(path)
            video.check_even()
            return Footage(camera, path, video)
        files = pictures_in(path)
        if not files:
            raise DataError(
                f"{path}: the folder of camera {camera} holds no pictures.",
                "Put them there, or remove the camera.",
            )
        return Footage(camera, path, None, tuple(files))

    def __len__(self) -> int:
        return len(self.files) if self.video is None else len(self.video)

    def header(self, number: int) -> Header:
        """Of a picture.

        Raises:
            DataError: it is a file that is no picture.
        """
        return read_header(self.files[number]) if self.video is None else self.video.header

    def name(self, number: int) -> str:
        """Of a picture, as messages and result files call it."""
        if self.video is None:
            return f"{self.camera}/{self.files[number].name}"
        return f"{self.camera}/{number:06d}"

    def source(self, number: int) -> tuple[Path, Shot | None]:
        """Where a picture is: in a file of its own, or in a video."""
        if self.video is None:
            return self.files[number], None
        return self.path, Shot(self.video, number)


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder, in order of the numbers in their names."""
    found = [item for item in folder.iterdir() if item.suffix.lower() in EXTENSIONS]
    return sorted(found, key=in_order)


def in_order(path: Path) -> tuple[object, ...]:
    """Sorts img_2 before img_10."""
    parts = re.split(r"(\d+)", path.name)
    return tuple((int(part), part) if part.isdecimal() else part for part in parts)


def find_footage(folder: Path, prefix: str = "") -> dict[str, Path]:
    """Videos, or else folders of pictures, whose names begin so, by the camera's name; sorted.

    Pictures lie in CAMERA/images or in CAMERA itself.
    """
    items = sorted(folder.iterdir()) if folder.is_dir() else []
    items = [item for item in items if item.name.lower().startswith(prefix)]
    videos = {item.stem: item for item in items if is_video(item)}
    if videos:
        return videos
    found = {}
    for item in items:
        for pictures in (item / "images", item):
            if pictures.is_dir() and pictures_in(pictures):
                found[item.name] = pictures
                break
    return found


def common_rate(footages: Sequence[Footage], asked: float, usual: float) -> tuple[float, str]:
    """Pictures per second of synchronised footage, and who says so.

    Args:
        footages: of all cameras.
        asked: what the user says; 0 for nothing.
        usual: of the format, where there are no videos to say it.

    Raises:
        DataError: the videos' rates differ.
    """
    if asked > 0:
        return asked, "datamanager.fps"
    rated = [(item.video.rate, item) for item in footages if item.video and item.video.rate > 0]
    if not rated:
        return usual, "the usual one; datamanager.fps=N gives another"
    rate, first = rated[0]
    for other, item in rated:
        if abs(other - rate) > SAME_RATE * rate:
            raise DataError(
                f"{item.path} has {other:.5g} pictures per second, {first.path} {rate:.5g}.",
                "Cameras are matched by picture numbers: write the videos anew at one rate "
                f"(ffmpeg -i OLD.mp4 -vf fps={rate:.5g} NEW.mp4).",
            )
    return rate, "the videos'"


def common_length(footages: Sequence[Footage]) -> tuple[int, tuple[str, ...]]:
    """How many pictures every camera has, and a note where some have more."""
    counts = {item.camera: len(item) for item in footages}
    shortest = min(counts, key=lambda camera: counts[camera])
    length, longest = counts[shortest], max(counts.values())
    if length == longest:
        return length, ()
    return length, (
        f"camera {shortest} has {length} pictures, others up to {longest}: the first {length} of "
        "each are used",
    )
