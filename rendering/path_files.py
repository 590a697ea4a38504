"""Path files: cameras of a film that a file lists, recognised by content.

Our key frames (``key_frames``), nerfstudio's camera_path.json, and transforms.json as Blender's and
NeRF's tools write it. Poses of the last two are in OpenGL axes (x right, y up, z backward).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import parsed_json, read_json
from gsfw.rendering.key_frames import (
    LARGEST_SIDE,
    PathFrames,
    camera_path_of,
    path_frames,
    pose,
)

logger = logging.getLogger(__name__)

OPENCV_FROM_OPENGL = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64))
"""Turns the axes of a camera half around x."""

PLACEMENT = "dataparser_transforms.json"
"""nerfstudio's file beside a run: how it moved and scaled the world of the data."""

AGAIN = f"Copy {PLACEMENT} of the run again, or take it away: then the path is read as it is."

LARGEST_ANGLE = 3.13
"""Largest field of view, in radians."""

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
        return path_frames(camera_path_of(document, file), frames)
    if isinstance(document, dict) and _lists(document, "camera_path"):
        found = _nerfstudio(JsonFields.of(document, file))
    elif isinstance(document, dict) and _lists(document, "frames"):
        found = _transforms(JsonFields.of(document, file))
    else:
        raise DataError(f"{file} is no camera path.", f"Known are {KINDS}.")
    return found if frames is None else found.resampled(frames)


def _lists(document: Mapping[str, Any], key: str) -> bool:
    listed = document.get(key)
    return (
        isinstance(listed, list) and bool(listed) and all(isinstance(item, dict) for item in listed)
    )


def _nerfstudio(fields: JsonFields) -> PathFrames:
    """Every frame that ``ns-render camera-path`` would render."""
    listed = fields.objects("camera_path")
    times = None
    if all("render_time" in item for item in listed):
        times = _float64([item.number("render_time", low=0.0, high=1.0) for item in listed])
    return PathFrames(
        _in_the_data(_poses(listed, "camera_to_world"), fields.path),
        _float64([item.number("fov", 50.0, 0.1, 179.0) for item in listed]),
        times,
        fields.number("fps", 24.0, 0.1, 1000.0),
        int(fields.number("render_width", 0.0, 0.0, LARGEST_SIDE)),
        int(fields.number("render_height", 0.0, 0.0, LARGEST_SIDE)),
    )


def _poses(listed: Sequence[JsonFields], name: str) -> Float64[Tensor, "f 4 4"]:
    """Poses in OpenGL axes, in those of OpenCV."""
    return torch.stack([pose(item, name) for item in listed]) @ OPENCV_FROM_OPENGL


def _float64(values: Sequence[float]) -> Float64[Tensor, " f"]:
    return torch.tensor(values, dtype=torch.float64)


def _in_the_data(poses: Float64[Tensor, "f 4 4"], file: Path) -> Float64[Tensor, "f 4 4"]:
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
    placement = replace(JsonFields.of(read_json(beside, AGAIN), beside), remedy=AGAIN)
    poses = poses.clone()
    poses[:, :3, 3] /= placement.number("scale", low=1e-9, high=1e9)
    return torch.linalg.inv(pose(placement, "transform")) @ poses


def _transforms(fields: JsonFields) -> PathFrames:
    """The cameras of transforms.json, in the order of its frames."""
    listed = fields.objects("frames")
    width, height = (int(fields.number(key, 0.0, 0.0, LARGEST_SIDE)) for key in "wh")
    completed = (replace(item, values={**fields.values, **item.values}) for item in listed)
    fovs = [_vertical_fov(facts) for facts in completed]
    times = None
    moments = [item.optional_number("time", -MOST_SECONDS, MOST_SECONDS) for item in listed]
    known = [moment for moment in moments if moment is not None]
    if len(known) == len(listed):
        times = _float64(known)
        # Times beyond [0, 1] are in another unit: the film runs over all of the capture.
        if not bool((times >= 0).all() and (times <= 1).all()):
            times = (times - times.min()) / (times.max() - times.min()).clamp_min(1e-12)
    poses = _poses(listed, "transform_matrix")
    return PathFrames(poses, _float64(fovs), times, None, width, height)


def _vertical_fov(facts: JsonFields) -> float:
    """Vertical field of view in degrees, from whichever numbers a file has."""
    width, height = (facts.optional_number(key, 0.0, LARGEST_SIDE) or 0.0 for key in "wh")
    focal = facts.optional_number("fl_y", 0.0, 1e9) or facts.optional_number("fl_x", 0.0, 1e9)
    if height and focal:
        return math.degrees(2 * math.atan(height / (2 * focal)))
    upward = facts.optional_number("camera_angle_y", 0.0, LARGEST_ANGLE)
    if upward:
        return math.degrees(upward)
    across = facts.optional_number("camera_angle_x", 0.0, LARGEST_ANGLE)
    if not across:
        raise DataError(
            f"{facts.at} has no field of view.",
            "Add camera_angle_x (radians), or fl_y and h (pixels), to it or to the whole file.",
        )
    # Without sizes images are square, as those of NeRF's Blender scenes are.
    aspect = height / width if width and height else 1.0
    return math.degrees(2 * math.atan(math.tan(across / 2) * aspect))
