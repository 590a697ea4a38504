"""Path files: cameras of a film that a file lists, recognised by content.

Our key frames (``key_frames``), nerfstudio's camera_path.json, and transforms.json as Blender's and
NeRF's tools write it. Poses of the last two are in OpenGL axes (x right, y up, z backward).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import parsed_json
from gsfw.rendering.key_frames import PathFrames, camera_path_of, number, path_frames, pose

logger = logging.getLogger(__name__)

OPENCV_FROM_OPENGL = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64))
"""Turns the axes of a camera half around x."""

PLACEMENT = "dataparser_transforms.json"
"""nerfstudio's file beside a run: how it moved and scaled the world of the data."""

MOST_SECONDS = 1e16
"""Largest time of a frame, of either sign: microseconds since 1970 are less."""

KINDS = "key frames of gsfw's viewer, nerfstudio's camera_path.json, and transforms.json"


def read_path_file(file: Path, frames: int | None = None) -> PathFrames:
    """The frames of a path, in the world of the data.

    Args:
        file: JSON of any known kind.
        frames: number of frames; ``None``: as the file has it.

    Raises:
        DataError: it cannot be read, or is none of these.
    """
    try:
        document = parsed_json(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DataError(
            f"camera={file}: there is no such file.",
            "Give the path of a camera path, or the name of a view.",
        ) from None
    except (OSError, ValueError) as error:
        raise DataError(f"{file} cannot be read as JSON: {error}.", f"Known are {KINDS}.") from None
    if isinstance(document, dict) and "key_frames" in document:
        return path_frames(camera_path_of(document, str(file)), frames)
    if isinstance(document, dict) and _lists(document, "camera_path"):
        found = _nerfstudio(document, file)
    elif isinstance(document, dict) and _lists(document, "frames"):
        found = _transforms(document, file)
    else:
        raise DataError(f"{file} is no camera path.", f"Known are {KINDS}.")
    return found if frames is None else found.resampled(frames)


def _lists(document: Mapping[str, Any], key: str) -> bool:
    listed = document.get(key)
    return (
        isinstance(listed, list) and bool(listed) and all(isinstance(item, dict) for item in listed)
    )


def _nerfstudio(document: Mapping[str, Any], file: Path) -> PathFrames:
    """Every frame that ``ns-render camera-path`` would render."""
    listed = document["camera_path"]
    poses = torch.stack(
        [
            pose(item.get("camera_to_world"), f"{file}: camera {n}") @ OPENCV_FROM_OPENGL
            for n, item in enumerate(listed)
        ]
    )
    poses = _in_the_data(poses, file)
    fovs = [
        number(item.get("fov", 50), f"{file}: camera {n}: fov", 0.1, 179)
        for n, item in enumerate(listed)
    ]
    times = None
    if all("render_time" in item for item in listed):
        times = torch.tensor(
            [number(item["render_time"], f"{file}: render_time", 0, 1) for item in listed],
            dtype=torch.float64,
        )
    return PathFrames(
        poses,
        torch.tensor(fovs, dtype=torch.float64),
        times,
        number(document.get("fps", 24), f"{file}: fps", 0.1, 1000),
        int(number(document.get("render_width", 0), f"{file}: render_width", 0, 32768)),
        int(number(document.get("render_height", 0), f"{file}: render_height", 0, 32768)),
    )


def _in_the_data(poses: torch.Tensor, file: Path) -> torch.Tensor:
    """Undo nerfstudio's placement of the world, if the file of it lies beside the path."""
    beside = file.parent / PLACEMENT
    if not beside.is_file():
        logger.warning(
            "%s is read as it is: nerfstudio moves and scales its world, so put %s of its run "
            "beside the file if the film shows another place.",
            file,
            PLACEMENT,
        )
        return poses
    try:
        document = parsed_json(beside.read_text(encoding="utf-8"))
        scale = number(document.get("scale"), f"{beside}: scale", 1e-9, 1e9)
        placed = pose(document.get("transform"), str(beside))
    except (OSError, ValueError, AttributeError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(
            f"{beside} cannot be read: {error}.",
            f"Copy {PLACEMENT} of the run again, or take it away: then the path is read as it is.",
        ) from None
    poses = poses.clone()
    poses[:, :3, 3] /= scale
    return torch.linalg.inv(placed) @ poses


def _transforms(document: Mapping[str, Any], file: Path) -> PathFrames:
    """The cameras of transforms.json, in the order of its frames."""
    listed = document["frames"]
    poses = torch.stack(
        [
            pose(item.get("transform_matrix"), f"{file}: frame {n}") @ OPENCV_FROM_OPENGL
            for n, item in enumerate(listed)
        ]
    )
    width, height = (int(number(document.get(key, 0), f"{file}: {key}", 0, 32768)) for key in "wh")
    fovs = [
        _vertical_fov({**document, **item}, f"{file}: frame {n}") for n, item in enumerate(listed)
    ]
    times = None
    if all(item.get("time") is not None for item in listed):
        moments = [
            number(item["time"], f"{file}: frame {n}: time", -MOST_SECONDS, MOST_SECONDS)
            for n, item in enumerate(listed)
        ]
        seconds = torch.tensor(moments, dtype=torch.float64)
        # Times beyond [0, 1] are in another unit: the film runs over all of the capture.
        inside = bool((seconds >= 0).all() and (seconds <= 1).all())
        span = (seconds.max() - seconds.min()).clamp_min(1e-12)
        times = seconds if inside else (seconds - seconds.min()) / span
    return PathFrames(poses, torch.tensor(fovs, dtype=torch.float64), times, None, width, height)


def _vertical_fov(facts: Mapping[str, Any], source: str) -> float:
    """Vertical field of view in degrees, from whichever numbers a file has."""
    width, height = (number(facts.get(key) or 0, f"{source}: {key}", 0, 32768) for key in "wh")
    if height and (facts.get("fl_y") or facts.get("fl_x")):
        focal = number(facts.get("fl_y") or facts.get("fl_x"), f"{source}: fl_y", 1e-6, 1e9)
        return math.degrees(2 * math.atan(height / (2 * focal)))
    if facts.get("camera_angle_y"):
        return math.degrees(number(facts["camera_angle_y"], f"{source}: camera_angle_y", 0, 3.13))
    if not facts.get("camera_angle_x"):
        raise DataError(
            f"{source} has no field of view.",
            "Add camera_angle_x (radians), or fl_y and h (pixels), to it or to the whole file.",
        )
    across = number(facts["camera_angle_x"], f"{source}: camera_angle_x", 1e-3, 3.13)
    # Without sizes images are square, as those of NeRF's Blender scenes are.
    aspect = height / width if width and height else 1.0
    return math.degrees(2 * math.atan(math.tan(across / 2) * aspect))
