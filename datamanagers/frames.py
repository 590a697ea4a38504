"""Frames: the images of a data set, each with its camera, as a format's file describes them."""

from __future__ import annotations

import os
import sys
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.files.reading import is_there, readable
from gsfw.core.words import listed
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.map_file import MapFile
from gsfw.datamanagers.undistortion import LensRule, Undistortion, undistortion_of
from gsfw.datamanagers.video import Shot


@dataclass(frozen=True)
class Sightings:
    """``o`` pairs of a point and an image of a recording, each at most once."""

    points: Int64[np.ndarray, " o"]
    """Rows among the points; ascending."""
    frames: Int64[np.ndarray, " o"]
    """Rows among the frames."""
    errors: Float64[np.ndarray, " p"]
    """Reprojection error of each point: the mean distance in pixels between its matches and its
    projections, at the size of the images of the reconstruction."""

    @staticmethod
    def none() -> Sightings:
        """Sightings of a data set without points."""
        nothing = np.zeros(0, np.int64)
        return Sightings(nothing, nothing, np.zeros(0))


USUAL = LensRule()
"""Default treatment of distorted images."""


@dataclass(frozen=True)
class Frame:
    """One image of a recording, with its camera."""

    name: str
    """As the data set calls it; relative to its folder."""
    path: Path
    """File of the image, or of the video that ``shot`` is in."""
    header: Header
    """Size of the stored image, from ``read_header``."""
    lens: Lens
    """Camera model and distortion, in pixels of the image that the cameras were computed from."""
    world_to_camera: Float64[Tensor, "4 4"]
    """Rigid, OpenCV axes, in the world of the data."""
    camera: int = 0
    """Number of the physical camera, counted from 0."""
    time: float | None = None
    """In the data's own unit; ``None`` when it says nothing of time."""
    split: Split | None = None
    """The part the data set itself puts it in; ``None`` when it leaves that open."""
    mask: Path | None = None
    """Image that is bright where pixels are valid; ``None`` when all are."""
    moving: Path | None = None
    """Image that is bright where something moves; ``None`` when the data set does not say."""
    shot: Shot | None = None
    """The image in the video at ``path``; ``None`` if the path is that of an image."""
    maps: Mapping[str, MapFile] = field(default_factory=dict)
    """Files of per-view maps by name, such as "depth". The framework undistorts, shrinks, masks
    and caches them, and puts them into ``Batch.maps``. Every frame needs all maps that any frame
    has, except those under the depth rule: where a frame has none, they are unknown."""

    @property
    def short_names(self) -> tuple[Path, ...]:
        """The name, and without its first folder, as in images/a.jpg: for files named alike."""
        name = Path(self.name)
        return (name, Path(*name.parts[1:])) if len(name.parts) > 1 else (name,)

    def undistortion(self, rule: LensRule) -> Undistortion | None:
        """Undistortion of the image; ``None`` if its lens is a pinhole.

        Raises:
            DataError: the image's size contradicts the camera, or the distortion is no lens's.
        """
        self._check_size()
        if self.lens.is_pinhole:
            return None
        return undistortion_of(self.lens.resized(self.header.width, self.header.height), rule)

    def camera_at(self, downscale: float, rule: LensRule = USUAL) -> Cameras:
        """The camera of the undistorted image shrunk by ``downscale``; float64.

        It is in the world of the data.

        Raises:
            DataError: the image's size contradicts the camera, or the distortion is no lens's.
        """
        undistortion = self.undistortion(rule)
        lens = self.lens if undistortion is None else undistortion.target
        shown = self.header if undistortion is None else lens
        return Cameras(
            self.world_to_camera[None],
            lens.matrix()[None],
            lens.width,
            lens.height,
            CameraModel.PINHOLE if lens.is_pinhole else CameraModel.FISHEYE,
        ).resized(
            max(1, round(shown.width / downscale)),
            max(1, round(shown.height / downscale)),
        )

    def _check_size(self) -> None:
        width, height = self.header.width, self.header.height
        factor = max(1, round(self.lens.width / width))
        # Tools that shrink images round down, up or to the nearest: Mip-NeRF 360's images_4.
        slack = 1 if factor > 1 else 0
        differences = (self.lens.width / factor - width, self.lens.height / factor - height)
        if all(difference == 0 or abs(difference) < slack for difference in differences):
            return
        advice = "Use the images that the cameras were computed from"
        if (height, width) == (self.lens.width, self.lens.height):
            advice += "; these are turned by 90 degrees, and their EXIF data does not say so"
        raise DataError(
            f"{self.path} is {self.header}, but {self.lens.source} describes "
            f"{self.lens.width}x{self.lens.height}.",
            f"{advice}. Smaller ones are fine where both sides are smaller by the same whole "
            "number; downscale=N shrinks images and cameras together.",
        )


@dataclass(frozen=True)
class Recording:
    """Contents of a format's files, before anything is held out, moved or scaled."""

    name: str
    """Name of the capture, for folders and messages."""
    path: Path
    """The data set, for messages."""
    frames: tuple[Frame, ...]
    """In any order; views are sorted by name."""
    points: Float64[Tensor, "p 3"]
    """Surface points in the world of the data; [0, 3] when there are none."""
    point_colors: Float[Tensor, "p 3"]
    """Their colours in [0, 1]."""
    notes: tuple[str, ...] = ()
    """Notes on the reading, and on the parts left out."""
    up: str = ""
    """Upward direction in the world of the data ("z", "-y"), if the format states it."""
    unused_times: tuple[float, ...] = ()
    """Times of frames that are neither trained nor evaluated on."""
    point_times: Float64[Tensor, " p"] | None = None
    """Time of each point, in the unit of the frames' times; ``None`` if unknown."""
    shrunk: int = 1
    """The factor that the images were shrunk by before; ``downscale`` counts from full size."""
    split_origin: str = "the data set's own split"
    """Source of the frames' ``split``, if they have one."""
    whole_cameras: bool = True
    """False if the user wants no whole camera held out."""
    sightings: Callable[[], Sightings] | None = None
    """Reads which frames show which point, which training has no use for; ``None`` when the format
    does not say."""
    left_out: frozenset[str] = frozenset()
    """Names, without extensions, of images with a camera that settings of the format leave out."""

    @property
    def root(self) -> Path:
        """The folder of the data set, which settings that name folders are relative to."""
        return self.path if self.path.is_dir() else self.path.parent

    def read_sightings(self) -> Sightings:
        """The frames that show each point; none if the format does not state them.

        Raises:
            DataError: what says so is cut off or damaged.
        """
        return Sightings.none() if self.sightings is None else self.sightings()


def data_path(path: Path | None) -> Path:
    """The data set's folder or file, which exists.

    Raises:
        DataError: none was given, or it is not there.
    """
    if path is None:
        raise DataError(
            "the chosen datamanager reads files, and data is empty.",
            "Give the data set: data=DIR.",
        )
    if not is_there(path):
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


def name_key(name: str) -> str:
    """Equal for names that some disk takes for one.

    Disks of Windows and macOS take A.JPG for a.jpg; that of macOS also é for e with an accent.
    """
    return unicodedata.normalize("NFC", name).casefold()


def _alike(missing: Sequence[str], folder: Path) -> str:
    """A file whose name some disk takes for that of a missing one; empty if there is none."""
    names, keys = set(missing), {name_key(name) for name in missing}
    found = (item.relative_to(folder).as_posix() for item in folder.rglob("*"))
    # A link to nowhere has the name of the missing image itself.
    return next((name for name in found if name not in names and name_key(name) in keys), "")


def missing_images(
    missing: Sequence[str], total: int, looked_in: Path, *, has_setting: bool = False
) -> tuple[str, ...]:
    """The note on frames whose images are not on disk; none when all are there.

    ``has_setting`` is true for formats with the setting datamanager.images.

    Raises:
        DataError: none of the images is there, or their folder cannot be read.
    """
    if not missing:
        return ()
    shown = listed(missing)
    encoding, hint = sys.getfilesystemencoding(), ""
    if encoding != "utf-8" and not f"{looked_in}{''.join(missing)}".isascii():
        hint = f" (this locale encodes names as {encoding}; PYTHONUTF8=1 finds those in UTF-8)"
    elif alike := _alike(missing, looked_in):
        hint = (
            f" ({alike} is there, whose name differs in upper and lower case or in the Unicode "
            "form of its accents: rename such files to the names of the data set)"
        )
    if len(missing) == total:
        if looked_in.is_dir():
            with readable(looked_in):
                os.listdir(looked_in)
                os.stat(f"{looked_in}/.")  # A folder may be listed, and its files be out of reach.
        raise DataError(
            f"none of the {total} images is in {looked_in} (looked for {shown}){hint}.",
            "Put the images there"
            + (", or name their folder (datamanager.images=DIR)." if has_setting else "."),
        )
    return (f"{len(missing)} of {total} images are not on disk and are left out: {shown}{hint}",)
