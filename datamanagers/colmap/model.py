"""The parts of a COLMAP model that gsfw uses, and where to find one.

The files are described at https://colmap.github.io/format.html.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from gsfw.core.errors import DataError
from gsfw.core.files.reading import check_downloaded

CAMERA_MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
)
"""Name and number of parameters by model number (COLMAP's src/colmap/sensor/models.h)."""


@dataclass(frozen=True)
class Tracks:
    """The images that show each point, one point after the other."""

    images: Int64[np.ndarray, " o"]
    """Numbers of images."""
    lengths: Int64[np.ndarray, " p"]
    """Number of images of each point."""
    errors: Float64[np.ndarray, " p"]
    """Reprojection error of each point, in pixels."""


@dataclass(frozen=True)
class ColmapCamera:
    """One line of cameras.txt."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """One registered image; its observations are not read."""

    name: str
    camera: int
    quaternion: tuple[float, ...]
    """World to camera, wxyz."""
    translation: tuple[float, ...]
    """World to camera."""
    number: int = 0
    """By which tracks of points name it."""


@dataclass(frozen=True)
class ColmapModel:
    """A sparse reconstruction."""

    cameras_file: Path
    """File of the cameras, for messages."""
    cameras: dict[int, ColmapCamera]
    images: list[ColmapImage]
    points: Float64[np.ndarray, "p 3"]
    colors: UInt8[np.ndarray, "p 3"]


def model_suffix(folder: Path) -> str | None:
    """Either .bin or .txt, whichever the cameras of the model in ``folder`` have."""
    return next((end for end in (".bin", ".txt") if (folder / f"cameras{end}").is_file()), None)


def model_folders(path: Path) -> list[Path]:
    """Folders of ``path`` that hold a model; the one with the most images comes first.

    COLMAP writes one folder for each part of a capture that it could not join to the others.
    """
    numbered = [item for item in (*path.glob("sparse/*"), *path.glob("*")) if item.name.isdecimal()]
    candidates = sorted(numbered, key=lambda folder: (-_images_bytes(folder), folder.name))
    folders = (*candidates, path / "sparse", path)
    return [folder for folder in folders if model_suffix(folder) is not None]


def _images_bytes(folder: Path) -> int:
    images = folder / f"images{model_suffix(folder)}"
    return images.stat().st_size if images.is_file() else 0


def damaged(file: Path, what: str) -> DataError:
    """The error for a model file that cannot be what it claims to be.

    Raises:
        DataError: the file was not downloaded.
    """
    check_downloaded(file)
    return DataError(
        f"{file} is cut off or damaged: {what}.",
        "Copy the model again, or write it anew with colmap model_converter.",
    )
