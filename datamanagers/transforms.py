"""The ``transforms`` format: transforms.json of nerfstudio and instant-ngp."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64, Num
from plyfile import PlyData, PlyElement
from torch import Tensor

from gsfw.core.config import DataManagerConfig, Detection
from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.frames import (
    Frame,
    Recording,
    data_folder,
    missing_pictures,
    no_points,
    number_cameras,
)
from gsfw.datamanagers.transforms_file import SPLIT_FILES, TransformsFile, plain_name

FILE = "transforms.json"


@dataclass
class TransformsConfig(DataManagerConfig):
    """Settings of the ``transforms`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a transforms.json, or such a file itself."""
        file = _file(path)
        if not file.is_file():
            return Detection(False, FILE)
        return Detection(True, FILE, file.name, priority=10)

    def build(self, request: DataRequest) -> Capture:
        """Read the file and its points, check the pictures' headers.

        Raises:
            DataError: the file is damaged, a camera is distorted, or the pictures do not fit.
        """
        path = data_folder(request.path, "transforms")
        file = _file(path)
        if not file.is_file():
            raise DataError(f"{path} holds no {FILE}.", "Give the folder that does, or the file.")
        return Capture(_recording(TransformsFile.read(file)), request)


def _file(path: Path) -> Path:
    is_own = path.suffix == ".json" and path.name not in SPLIT_FILES.values()
    return path if is_own and path.is_file() else path / FILE


def _recording(file: TransformsFile) -> Recording:
    listed, missing = file.frames()
    folder = file.path.absolute().parent
    missing_note = missing_pictures(missing, len(listed) + len(missing), folder)
    frames, split_note = _own_split(file, listed)
    points, colors, point_note = _points(file)
    return Recording(
        name=folder.name,
        path=file.path,
        frames=tuple(number_cameras(frames)),
        points=points,
        point_colors=colors,
        notes=(
            f"{file.path}: {len(listed) + len(missing)} frames, {len(points)} points",
            *missing_note,
            *split_note,
            *point_note,
        ),
        up="z",
        unused_times=file.times(),
    )


def _own_split(file: TransformsFile, frames: list[Frame]) -> tuple[list[Frame], tuple[str, ...]]:
    """The frames with the split of nerfstudio's file lists, and a note on those in no list."""
    train = file.names("train_filenames")
    held = file.names("test_filenames") or file.names("val_filenames")
    if not train and not held:
        return frames, ()
    split: list[Frame] = []
    for frame in frames:
        if frame.name in held or (train and not held and frame.name not in train):
            split.append(replace(frame, split=Split.EVAL))
        elif frame.name in train or not train:
            split.append(replace(frame, split=Split.TRAIN))
    if not split:
        raise DataError(
            f"{file.path}: none of its frames is in train_filenames or test_filenames.",
            "Write the names there as in file_path, or remove both lists.",
        )
    left_out = len(frames) - len(split)
    note = f"{left_out} frames are neither in train_filenames nor in test_filenames: left out"
    return split, (note,) if left_out else ()


Points = tuple[Float64[Tensor, "p 3"], Float[Tensor, "p 3"], tuple[str, ...]]


def _points(file: TransformsFile) -> Points:
    """Points, their colours, and a note when there should be some and are none."""
    name = file.content.get("ply_file_path")
    if not name:
        return *no_points(), ()
    path = file.path.parent / plain_name(str(name))
    if not path.is_file():
        return *no_points(), (f"its points (ply_file_path {name}) are not on disk",)
    try:
        vertices = PlyData.read(path)["vertex"]
        points = _columns(vertices, "xyz").astype(np.float64)
        colors = np.full(points.shape, 0.5)
        if "red" in vertices.data.dtype.names:
            colors = _columns(vertices, ("red", "green", "blue"))
            colors = colors / 255 if colors.dtype == np.uint8 else colors.clip(0, 1)
    except Exception as error:  # plyfile raises whatever a broken file makes it.
        raise DataError(
            f"{path} does not hold points: {error}",
            "Expected a PLY with x, y, z; remove ply_file_path to train without points.",
        ) from error
    if not np.isfinite(points).all():
        raise DataError(f"{path}: some of its points are not finite.", "Remove them.")
    return torch.from_numpy(points), torch.from_numpy(colors).float(), ()


def _columns(vertices: PlyElement, names: Iterable[str]) -> Num[np.ndarray, "p 3"]:
    return np.stack([np.asarray(vertices[name]) for name in names], axis=1)
