"""Writes what any format's file says as a COLMAP model: cameras, images and points.

The files are described at https://colmap.github.io/format.html. Points have no tracks, as most
formats do not know them; times, masks and splits have no place in such a model.
"""

from __future__ import annotations

import os
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsfw.core.color_bytes import color_bytes
from gsfw.core.errors import DataError
from gsfw.core.maths.rotations import quaternions_of
from gsfw.datamanagers.colmap.model import CAMERA_MODELS, ColmapCamera, ColmapImage, ColmapModel
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.lens import COEFFICIENTS, ONE_FOCAL_LENGTH, Lens

NUMBERS = {name: number for number, (name, _) in enumerate(CAMERA_MODELS)}
TWO_FOCAL_LENGTHS = {
    "SIMPLE_PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "SIMPLE_DIVISION": "DIVISION",
    "SIMPLE_FISHEYE": "FISHEYE",
}
"""The same models where fx and fy differ; further coefficients are 0."""
UNKNOWN_ERROR = -1.0
"""COLMAP's value for a reprojection error that is not computed."""


def write_model(recording: Recording, folder: Path, image_root: Path, suffix: str = ".bin") -> None:
    """Write cameras, images and points3D into ``folder``; replaces what is there.

    Args:
        recording: what a format's file says.
        folder: of the model, usually sparse/0; made where it is not there.
        image_root: the folder that names of images are relative to.
        suffix: ".bin" or ".txt".

    Raises:
        DataError: an image is not in ``image_root``, or is one of a video.
        OSError: the files cannot be written.
    """
    model = _model(recording, folder / f"cameras{suffix}", image_root)
    folder.mkdir(parents=True, exist_ok=True)
    write = {".bin": _write_binary, ".txt": _write_text}[suffix]
    write(model, folder)


def _model(recording: Recording, file: Path, image_root: Path) -> ColmapModel:
    """The parts of a COLMAP model."""
    numbers: dict[tuple[int, Lens], int] = {}
    images = []
    for frame in recording.frames:
        # COLMAP's cameras are of the size of their images.
        lens = frame.lens.resized(frame.header.width, frame.header.height)
        number = numbers.setdefault((frame.camera, lens), len(numbers) + 1)
        pose = frame.world_to_camera
        translation = tuple(pose[:3, 3].tolist())
        name = _name(frame, image_root)
        images.append(
            ColmapImage(name, number, tuple(quaternions_of(pose[:3, :3]).tolist()), translation)
        )
    colors = color_bytes(recording.point_colors).numpy()
    cameras = {number: _camera(lens) for (_, lens), number in numbers.items()}
    return ColmapModel(file, cameras, images, recording.points.numpy(), colors)


def _name(frame: Frame, image_root: Path) -> str:
    if frame.shot is not None:
        raise DataError(
            f"{frame.name} is an image of the video {frame.path}, which a COLMAP model cannot "
            "name.",
            f"Cut the video into images first (ffmpeg -i {frame.path.name} images/%06d.png).",
        )
    relative = Path(os.path.relpath(frame.path.resolve(), image_root.resolve())).as_posix()
    if relative.startswith("../"):
        raise DataError(
            f"{frame.path} is not in {image_root}, which the model's names are relative to.",
            "Copy the images there, or give a folder that holds all of them.",
        )
    return relative


def _camera(lens: Lens) -> ColmapCamera:
    lens.check()
    if lens.model in TWO_FOCAL_LENGTHS and lens.fx != lens.fy:
        model = TWO_FOCAL_LENGTHS[lens.model]
        missing = len(COEFFICIENTS[model]) - len(lens.distortion)
        lens = replace(lens, model=model, distortion=(*lens.distortion, *(0.0,) * missing))
    focal = (lens.fx,) if lens.model in ONE_FOCAL_LENGTH else (lens.fx, lens.fy)
    parameters = (*focal, lens.cx, lens.cy, *lens.distortion)
    return ColmapCamera(lens.model, lens.width, lens.height, parameters)


def _write_binary(model: ColmapModel, folder: Path) -> None:
    cameras = [struct.pack("<Q", len(model.cameras))]
    for number, camera in model.cameras.items():
        size = (camera.width, camera.height)
        cameras.append(struct.pack("<iiQQ", number, NUMBERS[camera.model], *size))
        cameras.append(struct.pack(f"<{len(camera.parameters)}d", *camera.parameters))
    (folder / "cameras.bin").write_bytes(b"".join(cameras))
    images = [struct.pack("<Q", len(model.images))]
    for number, image in enumerate(model.images, 1):
        pose = (*image.quaternion, *image.translation)
        images.append(struct.pack("<i7di", number, *pose, image.camera))
        images.append(image.name.encode() + b"\0" + struct.pack("<Q", 0))
    (folder / "images.bin").write_bytes(b"".join(images))
    layout = [
        ("id", "<u8"),
        ("xyz", "<f8", 3),
        ("rgb", "u1", 3),
        ("error", "<f8"),
        ("track", "<u8"),
    ]
    points = np.zeros(len(model.points), np.dtype(layout))
    points["id"] = np.arange(1, len(points) + 1)
    points["xyz"], points["rgb"], points["error"] = model.points, model.colors, UNKNOWN_ERROR
    content = struct.pack("<Q", len(points)) + points.tobytes()
    (folder / "points3D.bin").write_bytes(content)


def _write_text(model: ColmapModel, folder: Path) -> None:
    cameras = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS"]
    for number, camera in model.cameras.items():
        size = f"{camera.width} {camera.height}"
        cameras.append(f"{number} {camera.model} {size} {_numbers(camera.parameters)}")
    images = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of observations"]
    for number, image in enumerate(model.images, 1):
        pose = _numbers((*image.quaternion, *image.translation))
        images += [f"{number} {pose} {image.camera} {image.name}", ""]
    points = ["# POINT3D_ID X Y Z R G B ERROR TRACK"]
    places, colors = model.points.tolist(), model.colors.tolist()
    for number, (place, color) in enumerate(zip(places, colors, strict=True), 1):
        rgb = " ".join(map(str, color))
        points.append(f"{number} {_numbers(place)} {rgb} {UNKNOWN_ERROR}")
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n", "utf-8")


def _numbers(values: tuple[float, ...] | list[float]) -> str:
    """Write numbers with all the digits that distinguish them from others."""
    return " ".join(map(repr, values))
