"""Writes what any format's file says as a transforms.json of nerfstudio, which keeps times.

See https://docs.nerf.studio/quickstart/data_conventions.html; time, camera_index, motion_mask_path
and depth_unit_scale_factor of frames are ours: gsfw reads them, and others pass over them.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.lens import COEFFICIENTS, Lens
from gsfw.datamanagers.map_file import DEPTH
from gsfw.datamanagers.point_file import ply_of
from gsfw.datamanagers.transforms_file import CAMERA_KEY, DEPTH_KEY

FILE, POINTS_FILE = "transforms.json", "points.ply"
NERFSTUDIO_MODELS = {
    "SIMPLE_PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "SIMPLE_FISHEYE": "OPENCV_FISHEYE",
    "FISHEYE": "OPENCV_FISHEYE",
    "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}
"""The same lenses by names that nerfstudio knows; further coefficients are 0."""


def write_transforms(recording: Recording, folder: Path) -> int:
    """Write transforms.json into ``folder``, and points.ply where there are points.

    Args:
        recording: what a format's file says; its files are in ``folder``.
        folder: of the data set.

    Returns:
        Bytes written.

    Raises:
        DataError: a file is not in ``folder``, or a frame is an image of a video.
        OutputError: a file cannot be written.
    """
    content: dict[str, Any] = {}
    lenses = [_lens(frame) for frame in recording.frames]
    is_shared = all(lens == lenses[0] for lens in lenses)
    if is_shared:
        content |= lenses[0]
    points = ply_of(recording.points, recording.point_colors) if len(recording.points) else b""
    if points:
        content["ply_file_path"] = POINTS_FILE
    content |= _splits(recording.frames, folder)
    content["frames"] = [
        _frame(frame, folder) | ({} if is_shared else lens)
        for frame, lens in zip(recording.frames, lenses, strict=True)
    ]
    text = (json_text(content, indent=1) + "\n").encode()
    if points:
        write_atomically(folder / POINTS_FILE, points)
    write_atomically(folder / FILE, text)
    return len(points) + len(text)


def _lens(frame: Frame) -> dict[str, Any]:
    """The settings of a frame's lens, in pixels of its image."""
    lens: Lens = frame.lens.resized(frame.header.width, frame.header.height)
    lens.check()
    model = NERFSTUDIO_MODELS.get(lens.model, lens.model)
    values = dict(zip(COEFFICIENTS[lens.model], lens.distortion, strict=True))
    return {
        "camera_model": model,
        "fl_x": lens.fx,
        "fl_y": lens.fy,
        "cx": lens.cx,
        "cy": lens.cy,
        "w": lens.width,
        "h": lens.height,
    } | {name: values.get(name, 0.0) for name in COEFFICIENTS[model]}


def _splits(frames: Sequence[Frame], folder: Path) -> dict[str, list[str]]:
    """The lists of names; none where the data set leaves it open what is held out."""
    if all(frame.split is None for frame in frames):
        return {}
    train, held = (
        [_inside(frame.path, folder) for frame in frames if (frame.split is Split.EVAL) == is_held]
        for is_held in (False, True)
    )
    # nerfstudio wants all three lists where there is one.
    return {"train_filenames": train, "val_filenames": held, "test_filenames": held}


def _frame(frame: Frame, folder: Path) -> dict[str, Any]:
    if frame.shot is not None:
        raise DataError(
            f"{frame.name} is an image of the video {frame.path}, which a {FILE} cannot name.",
            f"Cut the video into images first (ffmpeg -i {frame.path.name} images/%06d.png).",
        )
    entry: dict[str, Any] = {
        "file_path": _inside(frame.path, folder),
        "transform_matrix": _to_opengl(frame.world_to_camera).tolist(),
        CAMERA_KEY: frame.camera,
    }
    if frame.time is not None:
        entry["time"] = frame.time
    if frame.mask is not None:
        entry["mask_path"] = _inside(frame.mask, folder)
    if frame.moving is not None:
        entry["motion_mask_path"] = _inside(frame.moving, folder)
    if (depth := frame.maps.get(DEPTH)) is not None:
        entry[DEPTH_KEY] = _inside(depth.path, folder)
        entry["depth_unit_scale_factor"] = depth.unit
    return entry


def _to_opengl(world_to_camera: Float64[Tensor, "4 4"]) -> Float64[Tensor, "4 4"]:
    """The camera-to-world matrix with OpenGL axes (x right, y up, z back) of a rigid pose."""
    rotation, translation = world_to_camera[:3, :3], world_to_camera[:3, 3]
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = rotation.T * torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    pose[:3, 3] = -(rotation.T @ translation)
    return pose


def _inside(file: Path, folder: Path) -> str:
    """A file's name relative to the folder."""
    relative = Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    if relative.startswith("../"):
        raise DataError(
            f"{file} is not in {folder}, which names in {FILE} are relative to.",
            "Copy the files there, or give a folder that holds all of them.",
        )
    return relative
