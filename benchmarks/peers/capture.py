"""The common input of all trainers: training views as PNG files with a COLMAP model."""

from __future__ import annotations

from pathlib import Path

import torch
from PIL import Image

from gsfw.core.batch import Batch
from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.color_bytes import color_bytes
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.writer import write_model
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.lens import Lens

IMAGES, MODEL = "images", "sparse/0"
"""Folders that readers of COLMAP models expect."""


def write_training_views(data: DataManager, folder: Path) -> Path:
    """Write the training views, at the size of training, in the world of the data.

    Held-out views are not written, so that no trainer can learn from them.

    Args:
        data: a static capture.
        folder: gets images/ and sparse/0/; both are replaced.

    Raises:
        DataError: the capture has something that other trainers do not read.
    """
    _check(data)
    images = folder / IMAGES
    images.mkdir(parents=True, exist_ok=True)
    for old in images.glob("*.png"):
        old.unlink()
    views, world = data.views(Split.TRAIN), data.scene.world_from_scene
    frames = []
    for index, (name, camera) in enumerate(zip(views.names, views.cameras, strict=True)):
        (batch,) = data.load(Split.TRAIN, [index], torch.device("cpu"))
        file = images / f"{Path(name).with_suffix('').as_posix().replace('/', '_')}.png"
        if file.exists():
            file = file.with_stem(f"{file.stem}_{index}")
        _write(batch, file)
        pose = world.camera(camera.world_to_camera)[0]
        header = Header(camera.width, camera.height, has_alpha=False)
        frames.append(Frame(file.name, file, header, _lens(camera, str(file)), pose))
    recording = Recording(
        name=data.scene.name,
        path=folder,
        frames=tuple(frames),
        points=world.apply(data.scene.points),
        point_colors=data.scene.point_colors,
    )
    write_model(recording, folder / MODEL, images)
    # The original trainer keeps its own copy of the points beside the model.
    (folder / MODEL / "points3D.ply").unlink(missing_ok=True)
    return folder


def _check(data: DataManager) -> None:
    """Refuse captures that trainers read differently, or not at all."""
    scene = data.scene
    if scene.is_dynamic:
        raise DataError(
            f"{scene.name} moves, and the peers train still scenes.", "Give a still capture."
        )
    if len(scene.points) == 0:
        raise DataError(
            f"{scene.name} has no points, which the peers start from.",
            "Give a capture with a COLMAP model; gsfw prepare makes one.",
        )
    if scene.has_alpha:
        raise DataError(
            f"{scene.name} has images with alpha, which each trainer reads in its own way.",
            "Give a capture of opaque images.",
        )
    if any(camera.model is not CameraModel.PINHOLE for camera in data.views(Split.TRAIN).cameras):
        raise DataError(
            f"{scene.name} has images that are no pinhole's, which the peers do not read.",
            "Undistort them to pinholes with undistort=pinhole.",
        )


def _write(batch: Batch, file: Path) -> None:
    if batch.mask is not None:
        raise DataError(
            f"{file.stem} has a mask, which the peers do not read.", "Give a capture without masks."
        )
    Image.fromarray(color_bytes(batch.images[0]).numpy()).save(file)


def _lens(camera: Cameras, source: str) -> Lens:
    matrix = camera.intrinsics[0].double()
    fx, fy, cx, cy = (
        float(matrix[row, column]) for row, column in ((0, 0), (1, 1), (0, 2), (1, 2))
    )
    return Lens(fx, fy, cx, cy, camera.width, camera.height, source)
