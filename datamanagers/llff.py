"""The ``llff`` format: poses_bounds.npy and images of a static scene (Mildenhall et al. 2019).

Rows of poses_bounds.npy belong to the images in order of their names; images that were shrunk lie
in images_N. A row has 17 numbers: a 3x5 matrix [R | t | (h, w, f)] camera-to-world, whose axes are
down, right and back, then the nearest and the farthest depth. The principal point is the middle of
the image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.array_file import read_numbers
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.image_folder import ImageFolderConfig
from gsfw.datamanagers.images import EXTENSIONS, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_center
from gsfw.datamanagers.upright import upright

FILE = "poses_bounds.npy"


def read_rows(file: Path) -> Float64[np.ndarray, "v 17"]:
    """The rows of a poses_bounds.npy.

    Raises:
        DataError: it does not hold them.
    """
    rows = read_numbers(file)
    if rows.ndim != 2 or rows.shape[1] != 17 or len(rows) == 0:
        raise DataError(
            f"{file} holds numbers of the shape {list(rows.shape)}.",
            "Expected one row of 17 numbers for each camera, as LLFF writes them.",
        )
    return rows


def row_camera(row: Float64[np.ndarray, " 17"], where: str) -> tuple[Lens, Float64[Tensor, "4 4"]]:
    """The lens of a row, and its camera's pose (world-to-camera, OpenCV axes).

    Raises:
        DataError: the numbers are not those of a camera; begins with ``where``.
    """
    pose = torch.from_numpy(row[:15].reshape(3, 5))
    height, width, focal = pose[:, 4].tolist()
    if not np.isfinite([height, width]).all():
        raise DataError(f"{where}: its size is {width:g}x{height:g} pixels.", "Copy it again.")
    lens = Lens(focal, focal, width / 2, height / 2, round(width), round(height), where)
    lens.check()
    down, right, back = pose[:, 0], pose[:, 1], pose[:, 2]
    rotation = torch.stack([right, down, -back])
    return lens, pose_from_center(rotation, pose[:, 3], where)


LOOKED_FOR = f"{FILE} with images/, or with images_N/"


@dataclass
class LlffConfig(ImageFolderConfig):
    """Settings of the ``llff`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with poses_bounds.npy and a folder of images."""
        folder = root_of(path)
        images = _folders(folder) if (folder / FILE).is_file() else {}
        if not images:
            return Detection(False, LOOKED_FOR)
        names = ", ".join(f"{item.name}/" for item in images.values())
        # COLMAP's model, which such data sets may hold as well, knows more: points and lenses.
        return Detection(True, LOOKED_FOR, f"{FILE} with {names}", priority=25)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the poses and the headers of the images that fit ``downscale``."""
        root = root_of(path)
        shrunk, images = self._choose(root, downscale)
        return self._recording(root, images, shrunk)

    def _choose(self, root: Path, downscale: float) -> tuple[int, Path]:
        """By what the images were shrunk, and where they are.

        The smallest that are not smaller than asked for; else the largest that there are.
        """
        if self.images:
            folder = self.image_folder(root).path
            return next((n for n, item in _folders(root).items() if item == folder), 1), folder
        found = _folders(root)
        if not found:
            raise DataError(
                f"{root} contains no images: there is no images/ and no images_N/ with any.",
                "Copy the folder images, too, or name it: datamanager.images=DIR.",
            )
        shrunk = max((factor for factor in found if factor <= downscale), default=min(found))
        return shrunk, found[shrunk]

    def _recording(self, root: Path, images: Path, shrunk: int) -> Recording:
        file = root / FILE
        if not file.is_file():
            raise DataError(f"{root} contains no {FILE}.", "Give the folder that contains it.")
        table = read_rows(file)
        files = _images_in(images)
        if len(files) != len(table):
            raise DataError(
                f"{file} has {len(table)} cameras, but there are {len(files)} images in {images}.",
                "Expected one for each row, in the order of their names; images that LLFF left "
                "out have to be removed.",
            )
        frames = []
        for number, (row, path) in enumerate(zip(table, files, strict=True)):
            lens, pose = row_camera(row, f"{file}: row {number} ({path.name})")
            # Which row a lens is of does not make it another camera.
            lens = replace(lens, source=str(file))
            frames.append(upright(Frame(path.name, path, read_header(path), lens, pose)))
        numbers = {
            lens: number for number, lens in enumerate(dict.fromkeys(f.lens for f in frames))
        }
        (points, colors), point_note = self.start_points(root)
        return Recording(
            name=root.resolve().name,
            path=root,
            shrunk=shrunk,
            frames=tuple(replace(frame, camera=numbers[frame.lens]) for frame in frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {len(table)} cameras, images of {images} (1/{shrunk} of full size); "
                "the nearest and farthest depths are not used",
                *point_note,
            ),
        )


def root_of(path: Path) -> Path:
    """The folder of a data set, which a path names by itself or by its poses_bounds.npy."""
    return path.parent if path.name == FILE else path


def _folders(root: Path) -> dict[int, Path]:
    """The folders that hold images, by what those were shrunk by; sorted."""
    found = {}
    for item in root.glob("images*"):
        factor = item.name.removeprefix("images_") if item.name != "images" else "1"
        if factor.isdecimal() and int(factor) > 0 and item.is_dir() and _images_in(item):
            found[int(factor)] = item
    return dict(sorted(found.items()))


def _images_in(folder: Path) -> list[Path]:
    """The images of a folder, in the order that LLFF reads them in: plainly by name."""
    return sorted(item for item in folder.iterdir() if item.suffix.lower() in EXTENSIONS)
