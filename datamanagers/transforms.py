"""The ``transforms`` format: transforms.json of nerfstudio and instant-ngp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from gsfw.core.config import Detection
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import (
    Frame,
    Recording,
    missing_images,
    no_points,
    number_cameras,
)
from gsfw.datamanagers.point_file import Points, read_points
from gsfw.datamanagers.transforms_file import SPLIT_FILES, TransformsFile, plain_name

FILE = "transforms.json"


@dataclass
class TransformsConfig(CaptureConfig):
    """Settings of the ``transforms`` format."""

    depth: bool = False
    """True if measured depths (depth_file_path) are loaded, for plugins that train on them."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a transforms.json, or such a file itself."""
        file = _file(path)
        if not file.is_file():
            return Detection(False, FILE)
        return Detection(True, FILE, file.name, priority=10)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the file, its points and the headers of the images."""
        file = _file(path)
        if not file.is_file():
            raise DataError(
                f"{path} contains no {FILE}.", "Give the folder that contains it, or the file."
            )
        return _recording(replace(TransformsFile.read(file), with_depth=self.depth))


def _file(path: Path) -> Path:
    is_own = path.suffix == ".json" and path.name not in SPLIT_FILES.values()
    return path if is_own and path.is_file() else path / FILE


def _recording(file: TransformsFile) -> Recording:
    listed, missing = file.frames()
    folder = file.path.absolute().parent
    missing_note = missing_images(missing, len(listed) + len(missing), folder)
    frames, split_note = _own_split(file, listed)
    (points, colors), point_note = _points(file)
    return Recording(
        name=folder.name,
        path=file.path,
        frames=tuple(frames if file.numbers_cameras else number_cameras(frames)),
        points=points,
        point_colors=colors,
        notes=(
            f"{file.path}: {len(listed) + len(missing)} frames, {len(points)} points",
            *file.path_note(),
            *missing_note,
            *split_note,
            *point_note,
            *file.depth_note(),
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


def _points(file: TransformsFile) -> tuple[Points, tuple[str, ...]]:
    """Points, their colours, and a note when there should be some and are none."""
    name = file.content.get("ply_file_path")
    if not name:
        return no_points(), ()
    path = file.path.parent / plain_name(str(name))
    if not is_file(path):
        return no_points(), (f"its points (ply_file_path {name}) are not on disk",)
    return read_points(path, "ply_file_path"), ()
