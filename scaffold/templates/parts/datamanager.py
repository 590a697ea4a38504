"""Data manager my-part: a folder of images, and their cameras in poses.json.

    {"frames": [{"image": "images/000.png", "fx": 500, "fy": 500, "cx": 320, "cy": 240,
                 "world_to_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}

Image paths are relative to the folder; focal lengths and principal points are in pixels. Camera
axes are OpenCV's: x to the right, y down, z forward. There are no points to start from: training
starts at random, or with init=dense from the images.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from gsfw.api import (
    CaptureConfig,
    DataError,
    Detection,
    Frame,
    Lens,
    Recording,
    no_points,
    pose_from_opencv,
    read_header,
)

POSES = "poses.json"
"""Name of the file of cameras."""


@dataclass
class MyPartConfig(CaptureConfig):
    """Settings of data manager my-part, besides those of every capture."""

    poses: str = POSES
    """Name of the file of cameras in the folder."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with poses.json."""
        if not (path / POSES).is_file():
            return Detection(False, POSES)
        return Detection(True, POSES, POSES, priority=10)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the cameras, and the headers of the images.

        Raises:
            DataError: the file is missing or damaged; names the place.
        """
        file = path / self.poses
        try:
            content = json.loads(file.read_text("utf-8"))
        except (OSError, ValueError) as error:
            raise DataError(f"{file} cannot be read as JSON: {error}.") from error
        entries = content.get("frames") if isinstance(content, dict) else None
        if not isinstance(entries, list) or not entries:
            raise DataError(f"{file} has no list of frames.", "Expected {'frames': [...]}.")
        frames = [_frame(path, f"{file}: frame {i}", entry) for i, entry in enumerate(entries)]
        notes = (f"{file}: {len(frames)} images",)
        return Recording(path.resolve().name, path, tuple(frames), *no_points(), notes)


def _frame(folder: Path, where: str, entry: Any) -> Frame:
    """An image with its camera.

    Raises:
        DataError: a value is missing or wrong, or the image cannot be read.
    """
    try:
        name = str(entry["image"])
        fx, fy, cx, cy = (float(entry[key]) for key in ("fx", "fy", "cx", "cy"))
        pose = torch.tensor(entry["world_to_camera"], dtype=torch.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{where}: {type(error).__name__}: {error}.",
            "Expected image, fx, fy, cx, cy, and world_to_camera, a matrix of 4 x 4 numbers.",
        ) from error
    if pose.shape != (4, 4):
        raise DataError(f"{where}: world_to_camera has shape {[*pose.shape]}, expected [4, 4].")
    header = read_header(folder / name)
    lens = Lens(fx, fy, cx, cy, header.width, header.height, source=where)
    lens.check()
    return Frame(name, folder / name, header, lens, pose_from_opencv(pose, where))
