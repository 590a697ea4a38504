"""Image sequences of cameras that stand still: videos or folders of images, and their frames."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import Frame
from gsfw.datamanagers.images import EXTENSIONS, Header, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.video import Box, Shot, Video, is_video

USUAL_RATE = 30.0
"""Images per second of the recordings that papers use, where no video states it."""
SAME_RATE = 1e-3
"""Rates of synchronised videos may differ by this part of them: files hold rounded ones."""


@dataclass(frozen=True)
class CameraSequence:
    """The images of one camera, in order of time."""

    camera: str
    """Its name: that of the video without extension, or of the folder."""
    path: Path
    """The video, or the folder of the images."""
    video: Video | None
    """``None`` for a folder of images."""
    files: tuple[Path, ...] = ()
    """The images of the folder, in order; empty for a video."""

    @staticmethod
    def read(camera: str, path: Path) -> CameraSequence:
        """Look at a video's packets, or at the names in a folder.

        Raises:
            DataError: the video is damaged or its rate varies, or the folder contains no images.
            UnavailableError: it is a video, and PyAV is not installed.
        """
        if is_video(path):
            video = Video.read(path)
            video.check_even()
            return CameraSequence(camera, path, video)
        files = images_in(path)
        if not files:
            raise DataError(
                f"{path}: the folder of camera {camera} contains no images.",
                "Put them there, or remove the camera.",
            )
        return CameraSequence(camera, path, None, tuple(files))

    def __len__(self) -> int:
        return len(self.files) if self.video is None else len(self.video)

    def header(self, number: int) -> Header:
        """Header of an image.

        Raises:
            DataError: it is a file that is no image.
        """
        return read_header(self.files[number]) if self.video is None else self.video.header

    def name(self, number: int) -> str:
        """Name of an image in messages and result files."""
        if self.video is None:
            return f"{self.camera}/{self.files[number].name}"
        return f"{self.camera}/{number:06d}"

    def source(self, number: int) -> tuple[Path, Shot | None]:
        """Source of an image: a file of its own, or a video."""
        if self.video is None:
            return self.files[number], None
        return self.path, Shot(self.video, number)


def images_in(folder: Path) -> list[Path]:
    """The images of a folder, in order of the numbers in their names."""
    found = [item for item in folder.iterdir() if item.suffix.lower() in EXTENSIONS]
    return sorted(found, key=in_order)


def in_order(path: Path) -> tuple[object, ...]:
    """Sorts img_2 before img_10."""
    parts = re.split(r"(\d+)", path.name)
    return tuple((int(part), part) if part.isdecimal() else part for part in parts)


def find_sequences(folder: Path, prefix: str = "") -> dict[str, Path]:
    """Videos, or else folders of images, whose names begin so, by the camera's name; sorted.

    Images lie in CAMERA/images or in CAMERA itself.
    """
    items = sorted(folder.iterdir()) if folder.is_dir() else []
    items = [item for item in items if item.name.lower().startswith(prefix)]
    videos = {item.stem: item for item in items if is_video(item)}
    if videos:
        return videos
    found = {}
    for item in items:
        for images in (item / "images", item):
            if images.is_dir() and images_in(images):
                found[item.name] = images
                break
    return found


def common_rate(sequences: Sequence[CameraSequence], asked: float) -> tuple[float, str]:
    """Images per second of synchronised sequences, and the origin of that number.

    Args:
        sequences: of all cameras; those of images have no rate of their own.
        asked: ``datamanager.fps``; 0 for the rate of the videos, or else ``USUAL_RATE``.

    Raises:
        DataError: the videos' rates differ.
    """
    if asked > 0:
        return asked, "datamanager.fps"
    rated = [(item.video.rate, item) for item in sequences if item.video and item.video.rate > 0]
    if not rated:
        return USUAL_RATE, "the default; datamanager.fps=N sets another"
    rate, first = rated[0]
    for other, item in rated:
        if abs(other - rate) > SAME_RATE * rate:
            raise DataError(
                f"{item.path} has {other:.5g} images per second, {first.path} {rate:.5g}.",
                "Cameras are matched by image numbers: write the videos anew at one rate "
                f"(ffmpeg -i OLD.mp4 -vf fps={rate:.5g} NEW.mp4).",
            )
    return rate, "the videos'"


def common_length(sequences: Sequence[CameraSequence]) -> tuple[int, tuple[str, ...]]:
    """Number of images that every camera has, and a note if some have more."""
    counts = {item.camera: len(item) for item in sequences}
    shortest = min(counts, key=lambda camera: counts[camera])
    length, longest = counts[shortest], max(counts.values())
    if length == longest:
        return length, ()
    return length, (
        f"camera {shortest} has {length} images, others up to {longest}: the first {length} of "
        "each are used",
    )


BLACK = 16.0
"""Mean brightness of a bar, at most: black is 0, and compression leaves a little around it."""


def fit_to_video(lens: Lens, video: Video) -> tuple[Lens, Video, str]:
    """The lens in pixels of the video, the video without black bars, and a note on what was done.

    Raises:
        DataError: the video's size is not that of the lens, and was not made from it by scaling,
            with or without black bars.
    """
    width, height = video.header.width, video.header.height
    if (width, height) == (lens.width, lens.height):
        return lens, video, ""
    scale = min(width / lens.width, height / lens.height)
    shown = round(lens.width * scale), round(lens.height * scale)
    if max(abs(shown[0] - width), abs(shown[1] - height)) <= 1:
        note = f"{video.path.name} is {width}x{height}, {lens.width}x{lens.height} scaled"
        return lens.resized(width, height), video, note
    left, top = (width - shown[0]) // 2, (height - shown[1]) // 2
    box = left, top, left + shown[0], top + shown[1]
    if not _has_bars(video, box):
        advice = "Give the video that the camera was calibrated with, or calibrate with this one."
        if (height, width) == (lens.width, lens.height):
            advice = "They differ by a quarter turn; turn the video or the calibration. " + advice
        raise DataError(
            f"{video.path} is {video.header}, but {lens.source} describes "
            f"{lens.width}x{lens.height}, which is another shape, and there are no black bars.",
            advice,
        )
    note = (
        f"{video.path.name} is {width}x{height}, {lens.width}x{lens.height} scaled to "
        f"{shown[0]}x{shown[1]} between black bars, which are cut off"
    )
    return lens.resized(*shown), video.cropped(box), note


def _has_bars(video: Video, box: Box) -> bool:
    """True if the first image is black outside ``box``, and not all black within."""
    left, top, right, bottom = box
    brightness = video.image(0).mean(axis=2)
    inside = brightness[top:bottom, left:right]
    within = float(inside.mean()) if inside.size else 0.0
    bars = (
        brightness[:top],
        brightness[bottom:],
        brightness[top:bottom, :left],
        brightness[top:bottom, right:],
    )
    return within > BLACK and all(float(np.mean(bar)) <= BLACK for bar in bars if bar.size)


@dataclass(frozen=True)
class StandingCamera:
    """A camera that does not move, and what it has seen."""

    lens: Lens
    world_to_camera: Float64[Tensor, "4 4"]
    """Rigid, OpenCV axes, in the world of the data."""
    sequence: CameraSequence

    def fitted(self) -> tuple[StandingCamera, str]:
        """The camera with its lens in pixels of its video, and a note if either was changed.

        Raises:
            DataError: the video is not one of this lens.
        """
        if self.sequence.video is None:
            return self, ""
        lens, video, note = fit_to_video(self.lens, self.sequence.video)
        return replace(self, lens=lens, sequence=replace(self.sequence, video=video)), note

    def frame(self, number: int, camera: int, rate: float) -> Frame:
        """One image of its sequence.

        Raises:
            DataError: it is a file that is no image.
        """
        path, shot = self.sequence.source(number)
        return Frame(
            name=self.sequence.name(number),
            path=path,
            header=self.sequence.header(number),
            lens=self.lens,
            world_to_camera=self.world_to_camera,
            camera=camera,
            time=number / rate,
            shot=shot,
        )


def frames_of(
    cameras: Sequence[StandingCamera], times: range, rate: float
) -> tuple[list[Frame], tuple[str, ...]]:
    """The frames of all cameras at the given times, and notes on lenses and videos.

    Args:
        cameras: in the order that they are numbered in.
        times: numbers of the images.
        rate: images per second.

    Raises:
        DataError: a video is not one of its lens, or a file is no image.
    """
    frames: list[Frame] = []
    notes: list[str] = []
    for index, camera in enumerate(cameras):
        fitted, note = camera.fitted()
        frames.extend(fitted.frame(number, index, rate) for number in times)
        notes.extend([note] if note else [])
        if (video := camera.sequence.video) is not None:
            notes.extend(f"{video.path.name}: {note}" for note in video.traits.notes())
    return frames, tuple(notes)
