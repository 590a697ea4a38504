"""Frames: the pictures of a data set, each with its camera, as a format's file describes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.pictures import Header


@dataclass(frozen=True)
class Lens:
    """A pinhole camera, in pixels of the picture size that it describes."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    source: str = field(compare=False)
    """Who says so, for messages: "camera 1 of sparse/0/cameras.bin"."""

    def matrix(self) -> Float64[Tensor, "3 3"]:
        """The intrinsics."""
        return torch.tensor(
            [[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]],
            dtype=torch.float64,
        )

    def check(self) -> None:
        """Check the numbers.

        Raises:
            DataError: they are not those of a camera.
        """
        numbers = torch.tensor([self.fx, self.fy, self.cx, self.cy], dtype=torch.float64)
        if not numbers.isfinite().all() or min(self.fx, self.fy, self.width, self.height) <= 0:
            raise DataError(
                f"{self.source}: fx={self.fx:g}, fy={self.fy:g}, cx={self.cx:g}, cy={self.cy:g}, "
                f"{self.width}x{self.height} pixels is no camera.",
                "Focal lengths and sizes have to be positive, and all numbers finite.",
            )


@dataclass(frozen=True)
class Frame:
    """One picture."""

    name: str
    """As the data set calls it; relative to its folder."""
    path: Path
    header: Header
    lens: Lens
    world_to_camera: Float64[Tensor, "4 4"]
    """Rigid, OpenCV axes, in the world of the data."""
    camera: int = 0
    """Which physical camera, counted from 0."""
    time: float | None = None
    """In the data's own unit; ``None`` when it says nothing of time."""
    split: Split | None = None
    """The part the data set itself puts it in; ``None`` when it leaves that open."""
    mask: Path | None = None
    """Picture that is bright where pixels are valid; ``None`` when all are."""
    moving: Path | None = None
    """Picture that is bright where something moves; ``None`` when nobody said."""

    def camera_at(self, downscale: float) -> Cameras:
        """The camera in the world of the data, for the picture shrunk by ``downscale``; float64.

        Raises:
            DataError: the picture's size contradicts the camera.
        """
        self._check_size()
        return Cameras(
            self.world_to_camera[None], self.lens.matrix()[None], self.lens.width, self.lens.height
        ).resized(
            max(1, round(self.header.width / downscale)),
            max(1, round(self.header.height / downscale)),
        )

    def _check_size(self) -> None:
        width, height = self.header.width, self.header.height
        factor = max(1, round(self.lens.width / width))
        # Tools that shrink pictures round down, up or to the nearest: Mip-NeRF 360's images_4.
        slack = 1 if factor > 1 else 0
        differences = (self.lens.width / factor - width, self.lens.height / factor - height)
        if all(difference == 0 or abs(difference) < slack for difference in differences):
            return
        advice = "Use the pictures that the cameras were computed from"
        if (height, width) == (self.lens.width, self.lens.height):
            advice += (
                "; these are turned by 90 degrees (gsfw always applies EXIF orientation, so remove "
                "that tag if the cameras describe the picture as stored)"
            )
        raise DataError(
            f"{self.path} is {self.header}, but {self.lens.source} describes "
            f"{self.lens.width}x{self.lens.height}.",
            f"{advice}. Smaller ones are fine where both sides are smaller by the same whole "
            "number; downscale=N shrinks pictures and cameras together.",
        )


@dataclass(frozen=True)
class Recording:
    """What a format's file says, before anything is held out, moved or scaled."""

    name: str
    path: Path
    """The data set, for messages."""
    frames: tuple[Frame, ...]
    points: Float64[Tensor, "p 3"]
    """Surface points in the world of the data; [0, 3] when there are none."""
    point_colors: Float[Tensor, "p 3"]
    """Their colours in [0, 1]."""
    notes: tuple[str, ...] = ()
    """How it was read, and what was left out."""
    up: str = ""
    """Which way is up in the world of the data ("z", "-y"), as far as the format says."""
    unused_times: tuple[float, ...] = ()
    """Times of frames that are neither trained nor evaluated on."""


def data_folder(path: Path | None, format_name: str) -> Path:
    """The data set's folder or file.

    Raises:
        DataError: none was given, or it is not there.
    """
    if path is None:
        raise DataError(
            f"datamanager={format_name} reads files, and data is empty.",
            "Give the data set: data=DIR.",
        )
    if not path.exists():
        raise DataError(f"data={path}: there is no such file or folder.")
    return path


def number_cameras(frames: Sequence[Frame]) -> list[Frame]:
    """Frames of files that do not number cameras: frames with one lens have one camera.

    Where a pose comes back at other times, cameras stand still, and each has its own pose.
    """
    times: dict[object, set[float | None]] = {}
    for frame in frames:
        times.setdefault(_place(frame), set()).add(frame.time)
    standing = any(len(seen) > 1 for seen in times.values())
    numbers: dict[object, int] = {}
    return [
        replace(
            frame,
            camera=numbers.setdefault(_place(frame) if standing else frame.lens, len(numbers)),
        )
        for frame in frames
    ]


def _place(frame: Frame) -> object:
    """Equal for frames that one camera can have taken without being moved."""
    return frame.lens, tuple(frame.world_to_camera.flatten().tolist())


def no_points() -> tuple[Float64[Tensor, "0 3"], Float[Tensor, "0 3"]]:
    """Points and colours of a data set that has none."""
    return torch.zeros(0, 3, dtype=torch.float64), torch.zeros(0, 3)


def missing_pictures(missing: Sequence[str], total: int, looked_in: Path) -> tuple[str, ...]:
    """The note on frames whose pictures are not on disk; none when all are there.

    Raises:
        DataError: none of the pictures is there.
    """
    if not missing:
        return ()
    shown = ", ".join(missing[:5]) + (f" and {len(missing) - 5} more" if len(missing) > 5 else "")
    if len(missing) == total:
        raise DataError(
            f"none of the {total} pictures is in {looked_in} (looked for {shown}).",
            "Put the pictures there, or name their folder (datamanager.images=DIR for colmap).",
        )
    return (f"{len(missing)} of {total} pictures are not on disk and are left out: {shown}",)
