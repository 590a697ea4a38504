"""What `gsfw info` says of a data set."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.config import AUTO, DataManagerConfig
from gsfw.core.datamanager import DataManager, DataRequest, Split
from gsfw.core.errors import ConfigError
from gsfw.plugins.automatic import Choice, choose_datamanager
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry

LONG_SIDE = 1600
"""Images with a longer side are worth shrinking (as Kerbl et al. 2023's code does)."""


def describe_data(
    data: str, file_format: str, downscale: float, registry: Registry
) -> dict[str, Any]:
    """The document of a data set; reads cameras and points, and the headers of its pictures.

    Raises:
        ConfigError: there is no such format, or ``downscale`` is below 1.
        DataError: it cannot be used; says where and why.
    """
    if downscale < 1:
        raise ConfigError(f"downscale={downscale:g}: expected a factor of at least 1.")
    choice = (
        choose_datamanager(data, registry)
        if file_format == AUTO
        else Choice(file_format, "it was asked for")
    )
    kind: type[DataManagerConfig] = load("datamanager", registry.find("datamanager", choice.name))
    manager = kind().build(DataRequest(Path(data) if data else None, downscale=downscale))
    try:
        return {
            "kind": "data set",
            "path": data,
            "format": choice.name,
            "why": choice.reason,
            **_describe(manager),
            "notes": list(manager.notes()),
            "next": _command(data, file_format, downscale, manager),
        }
    finally:
        manager.close()


def _describe(manager: DataManager) -> dict[str, Any]:
    scene = manager.scene
    cameras = {split: manager.views(split).cameras for split in Split}
    every = [camera for split in Split for camera in cameras[split]]
    channels = 4 if scene.has_alpha else 3
    decoded = sum(camera.width * camera.height for camera in every) * channels
    return {
        "views_train": len(cameras[Split.TRAIN]),
        "views_eval": len(cameras[Split.EVAL]),
        "image_sizes": _counted([f"{camera.width}x{camera.height}" for camera in every]),
        "camera_models": _counted([camera.model.value for camera in every]),
        "field_of_view": _fields_of_view(every),
        "alpha": scene.has_alpha,
        "points": len(scene.points),
        "extent": _extent(manager),
        "times": scene.num_times,
        "time_range": None if scene.time_range is None else list(scene.time_range),
        "decoded_mb": round(decoded / 1e6, 1),
        "decoded_fits_cache": decoded <= 1e6 * DataRequest(None).cache_megabytes,
    }


def _counted(texts: Sequence[str]) -> list[str]:
    """Each different text with how often it is there, the most frequent first."""
    return [f"{text} ({count})" for text, count in Counter(texts).most_common()]


def _fields_of_view(cameras: Sequence[Cameras]) -> list[float]:
    """Least and largest horizontal angle, in degrees."""
    angles = [_field_of_view(camera) for camera in cameras]
    return sorted({round(min(angles), 1), round(max(angles), 1)})


def _field_of_view(camera: Cameras) -> float:
    half = 0.5 * camera.width / float(camera.intrinsics[0, 0, 0])
    # A fisheye's pixels are at equal angles, not at equal distances on a plane.
    return math.degrees(2 * (half if camera.model is CameraModel.FISHEYE else math.atan(half)))


def _extent(manager: DataManager) -> dict[str, float]:
    """Sizes in the world of the data: around the cameras, and around the middle of the points."""
    scene = manager.scene
    unit = scene.world_from_scene.scale
    extent = {"cameras": unit * scene.extent}
    if len(scene.points):
        middle = scene.points.median(dim=0).values
        extent["points_median"] = unit * float((scene.points - middle).norm(dim=1).median())
    return extent


def _command(data: str, file_format: str, downscale: float, manager: DataManager) -> str:
    """A command line that trains it, with images of a sensible size."""
    words = ["gsfw", "train", "method=3dgs"]
    words += [f"data={data}"] if data else []
    words += [f"datamanager={file_format}"] if file_format != AUTO else []
    longest = max(max(c.width, c.height) for c in manager.views(Split.TRAIN).cameras)
    while longest > LONG_SIDE:
        downscale, longest = downscale * 2, longest // 2
    words += [f"downscale={downscale:g}"] if downscale > 1 else []
    return shlex.join(words)
