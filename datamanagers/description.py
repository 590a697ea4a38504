"""Description of a data set as plain data for `gsfw info`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataManager, DataRequest, Split

LONG_SIDE = 1600
"""Images with a longer side are worth shrinking (as Kerbl et al. 2023's code does)."""


def describe_data(manager: DataManager) -> dict[str, Any]:
    """Figures of cameras, images, points and times; decodes no image."""
    scene = manager.scene
    cameras = {split: manager.views(split).cameras for split in Split}
    every = [camera for split in Split for camera in cameras[split]]
    channels = 4 if scene.has_alpha else 3
    decoded = sum(camera.width * camera.height for camera in every) * channels
    return {
        "views_train": len(cameras[Split.TRAIN]),
        "views_eval": len(cameras[Split.EVAL]),
        "image_sizes": with_counts(f"{camera.width}x{camera.height}" for camera in every),
        "camera_models": with_counts(camera.model.value for camera in every),
        "field_of_view": _fields_of_view(every),
        "alpha": scene.has_alpha,
        "points": len(scene.points),
        "extent": _extent(manager),
        "times": scene.num_times,
        "time_range": None if scene.time_range is None else list(scene.time_range),
        "decoded_mb": round(decoded / 1e6, 1),
        "decoded_fits_cache": decoded <= 1e6 * DataRequest(None).cache_megabytes,
    }


def with_counts(texts: Iterable[str]) -> list[str]:
    """The different texts with their counts, the most frequent first."""
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


def fitting_downscale(manager: DataManager, downscale: float) -> float:
    """``downscale``, doubled until the images that have it are of a sensible size."""
    longest = max(max(c.width, c.height) for c in manager.views(Split.TRAIN).cameras)
    while longest > LONG_SIDE:
        downscale, longest = downscale * 2, longest // 2
    return downscale
