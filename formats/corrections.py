"""Corrections: files with the learnt exposures and refined cameras of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.scene import Scene

EXPOSURES = "exposures.json"
REFINED = "refined_transforms.json"

MODELS = {CameraModel.PINHOLE: "PINHOLE", CameraModel.FISHEYE: "OPENCV_FISHEYE"}
"""Names of camera models in nerfstudio."""


def write_corrections(parts: TrainingParts, folder: Path) -> list[Path]:
    """Write the learnt exposures and cameras; return the files, none if neither was trained.

    Raises:
        OutputError: one cannot be written.
    """
    corrections = parts.corrections
    documents: dict[str, dict[str, Any]] = {}
    if corrections.exposures is not None:
        documents[EXPOSURES] = corrections.exposures.document()
    if corrections.poses is not None:
        documents[REFINED] = refined_transforms(parts.data)
    for name, document in documents.items():
        RunFolder(folder).write_json(folder / name, document)
    return [folder / name for name in documents]


def refined_transforms(data: DataManager) -> dict[str, Any]:
    """All cameras as the content of a transforms.json, in the world of the data.

    They are those of the training images: undistorted, shrunk.
    """
    views = {split: data.views(split) for split in Split}
    return {
        "train_filenames": list(views[Split.TRAIN].names),
        "test_filenames": list(views[Split.EVAL].names),
        "frames": [
            {"file_path": name, **_frame(camera, data.scene)}
            for split in Split
            for name, camera in zip(views[split].names, views[split].cameras, strict=True)
        ],
    }


def _frame(camera: Cameras, scene: Scene) -> dict[str, Any]:
    """One camera: intrinsics in pixels, and camera-to-world with the axes of OpenGL."""
    pose = torch.linalg.inv(scene.world_from_scene.camera(camera.world_to_camera.cpu())[0])
    pose[:, 1:3] *= -1
    intrinsics = camera.intrinsics[0].double()
    frame = {
        "camera_model": MODELS.get(camera.model, camera.model.name),
        "w": camera.width,
        "h": camera.height,
        "fl_x": float(intrinsics[0, 0]),
        "fl_y": float(intrinsics[1, 1]),
        "cx": float(intrinsics[0, 2]),
        "cy": float(intrinsics[1, 2]),
        "transform_matrix": pose.tolist(),
    }
    return frame if camera.time is None else {**frame, "time": float(camera.time[0])}
