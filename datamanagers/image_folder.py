"""Image folder of formats whose files name images without a path."""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from posixpath import splitext

from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.words import listed
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, no_points
from gsfw.datamanagers.images import EXTENSIONS, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.point_file import Points, read_points
from gsfw.datamanagers.upright import upright


@dataclass
class ImageFolderConfig(CaptureConfig, ABC):
    """Settings of formats whose cameras lie beside the images."""

    images: str = ""
    """Folder of the images, relative to the data set. Empty: images, or the data set itself."""
    points: str = ""
    """PLY file of points to start from, relative to the data set. Empty: the only one there is."""

    def image_folder(self, root: Path) -> ImageFolder:
        """The folder to search for the images of the data set ``root``.

        Raises:
            DataError: there is no folder of the name that was given.
        """
        folder = root / (self.images or ("images" if (root / "images").is_dir() else ""))
        if not folder.is_dir():
            raise DataError(f"datamanager.images={self.images}: there is no folder {folder}.")
        return ImageFolder(folder)

    def start_points(self, root: Path, own: Points | None = None) -> tuple[Points, tuple[str, ...]]:
        """Points of a PLY file, their colours, and a note on where they are from.

        Points of the format's ``own`` file, where it has any, come before an unnamed PLY file.

        Raises:
            DataError: there is no file of the name that was given, or it contains no points.
        """
        if self.points:
            file = root / self.points
            if not file.is_file():
                raise DataError(f"datamanager.points={self.points}: there is no file {file}.")
            return _read(file, "datamanager.points")
        if own is not None and len(own[0]):
            return own, ()
        found = sorted(item for item in root.glob("*.[pP][lL][yY]") if item.is_file())
        if len(found) == 1:
            return _read(found[0], "it")
        if found:
            names = ", ".join(item.name for item in found)
            return no_points(), (f"no points are used; datamanager.points=FILE picks of {names}",)
        return no_points(), ("there are no points (a PLY file in the data set would be used)",)


def _read(file: Path, setting: str) -> tuple[Points, tuple[str, ...]]:
    points = read_points(file, setting)
    return points, (f"{file}: {len(points[0])} points",)


@dataclass(frozen=True)
class ImageFolder:
    """The images in a folder and the folders in it."""

    path: Path

    @cached_property
    def _by_name(self) -> dict[str, list[Path]]:
        """Images by relative path, by name, and by each without its extension; lower case."""
        found: dict[str, list[Path]] = {}
        for item in sorted(self.path.rglob("*")):
            if item.suffix.lower() in EXTENSIONS:
                relative = item.relative_to(self.path)
                names = (relative.as_posix(), relative.name)
                for key in {each.lower() for name in names for each in _with_and_without(name)}:
                    found.setdefault(key, []).append(item)
        return found

    def find(self, name: str, where: str) -> Path | None:
        """The image that a file calls ``name``, with or without folders and extension.

        Raises:
            DataError: several can be meant; begins with ``where``.
        """
        # The path that was right where the file was written is tried from its longest end.
        parts = PurePosixPath(name.replace("\\", "/").lower()).parts
        for start in range(len(parts)):
            for key in _with_and_without(PurePosixPath(*parts[start:]).as_posix()):
                candidates = self._by_name.get(key, [])
                exact = [item for item in candidates if self._is_at(item, key)]
                candidates = exact or candidates
                if len(candidates) == 1:
                    return candidates[0]
                if candidates:
                    shown = ", ".join(str(item.relative_to(self.path)) for item in candidates[:3])
                    raise DataError(
                        f"{where}: {name} can be any of {len(candidates)} images in {self.path} "
                        f"({shown}).",
                        "Give the folder that holds one of each with datamanager.images=DIR.",
                    )
        return None

    def frame(
        self, image: Path, lens: Lens, world_to_camera: Float64[Tensor, "4 4"], camera: int
    ) -> Frame:
        """The upright frame of one of these images."""
        header = read_header(image)
        return upright(Frame(self.name(image), image, header, lens, world_to_camera, camera))

    def _is_at(self, image: Path, key: str) -> bool:
        """True if ``key`` is the image's path, with or without its extension."""
        return key in _with_and_without(image.relative_to(self.path).as_posix().lower())

    def name(self, image: Path) -> str:
        """Name of an image in messages and result files."""
        return image.relative_to(self.path).as_posix()


def _with_and_without(name: str) -> tuple[str, str]:
    """A name with its extension, and without. Path.with_suffix refuses some, such as ``..png``."""
    return name, splitext(name)[0]


def only_file(path: Path, files: Sequence[Path], expected: str, advice: str) -> Path:
    """The one file of cameras in a data set.

    Raises:
        DataError: there is none, or there are several.
    """
    if len(files) != 1:
        found = ", ".join(item.name for item in files) or "none"
        raise DataError(f"{path} has to hold one {expected}; found {found}.", advice)
    return files[0]


def left_out(names: Iterable[str], why: str) -> tuple[str, ...]:
    """The note on images that are left out; none when there are none."""
    all_names = list(names)
    if not all_names:
        return ()
    return (f"{len(all_names)} images {why} are left out: {listed(all_names)}",)
