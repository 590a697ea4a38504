"""Camera path files: key frames of ours, which the viewer writes, and the paths of other tools."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import json_text
from gsfw.rendering.splines import PoseSpline, hermite, interpolate

SCHEMA = 1
"""Version of our layout."""

FPS, SECONDS = 30.0, 6.0
"""Frames per second and length in seconds of a new path."""

MOST_FRAMES = 1_000_000
"""Most frames of a film: nine hours at 30 per second."""

MOST_SECONDS = 1e5
"""Longest film: a day."""

LARGEST_SIDE = 32768.0
"""Largest width and height of frames, in pixels."""

LAYOUT = "Correct the value; docs/guides/render.md has the layout."
"""Next action after a wrong value in a file of ours."""

SKEW = 0.01
"""Largest difference of the three axes of a pose, of their length, that rounding explains."""


@dataclass(frozen=True)
class KeyFrame:
    """A pose that the camera passes."""

    camera_to_world: Float[Tensor, "4 4"]
    """Rigid, in the world of the data; OpenCV axes (x right, y down, z forward)."""
    fov: float
    """Vertical field of view, in degrees."""
    time: float | None = None
    """Time of a moving scene, in [0, 1]. All of a path, or none: then it is that of the command."""
    seconds: float | None = None
    """Time at which the film passes it, from its start. All of a path, or none: then the camera
    has one speed, or, where the times of key frames differ, every step takes equally long."""


@dataclass(frozen=True)
class CameraPath:
    """Key frames, and the film that leads through them."""

    key_frames: tuple[KeyFrame, ...]
    """At least one."""
    fps: float = FPS
    """Frames per second."""
    seconds: float = SECONDS
    """Length of the film."""
    closed: bool = False
    """The film returns to the first key frame, so that it can be repeated."""
    width: int = 0
    """Width of the frames, in pixels; 0: that of the training images."""
    height: int = 0

    def document(self) -> dict[str, Any]:
        """Plain data, as the file has it."""
        return {
            "schema": SCHEMA,
            "kind": "gsfw camera path",
            "fps": self.fps,
            "seconds": self.seconds,
            "closed": self.closed,
            "width": self.width,
            "height": self.height,
            "key_frames": [
                {
                    "camera_to_world": frame.camera_to_world.tolist(),
                    "fov": frame.fov,
                    "time": frame.time,
                    "seconds": frame.seconds,
                }
                for frame in self.key_frames
            ],
        }


@dataclass(frozen=True)
class PathFrames:
    """Every frame of a path."""

    camera_to_world: Float64[Tensor, "f 4 4"]
    """In the world of the data; OpenCV axes."""
    fovs: Float64[Tensor, " f"]
    """Vertical fields of view, in degrees."""
    times: Float64[Tensor, " f"] | None = None
    """In [0, 1]; ``None`` where the file has none."""
    fps: float | None = None
    """Frames per second; ``None`` where the file does not say."""
    width: int = 0
    """Width of the frames, in pixels; 0 where the file does not say."""
    height: int = 0

    def resampled(self, frames: int) -> PathFrames:
        """The same path with another number of frames, at the same speed profile."""
        if frames == len(self.fovs):
            return self
        knots = torch.arange(len(self.fovs), dtype=torch.float64)
        moments = torch.linspace(0, len(self.fovs) - 1, frames, dtype=torch.float64)
        return PathFrames(
            PoseSpline(self.camera_to_world, knots).at(moments),
            interpolate(self.fovs, knots, moments),
            None if self.times is None else interpolate(self.times, knots, moments),
            self.fps,
            self.width,
            self.height,
        )


def write_camera_path(file: Path, path: CameraPath) -> Path:
    """Write key frames as JSON; the file.

    Raises:
        OutputError: it cannot be written.
    """
    write_atomically(file, (json_text(path.document(), indent=1) + "\n").encode())
    return file


def camera_path_of(document: object, source: Path) -> CameraPath:
    """The key frames of a document.

    Args:
        document: the content of a file.
        source: the file, for messages.

    Raises:
        DataError: something is missing or out of range; names it.
    """
    if not isinstance(document, dict) or "key_frames" not in document:
        raise DataError(
            f"{source} is no camera path of gsfw: it has no key frames.",
            "The viewer writes one under Path; docs/guides/render.md has its layout.",
        )
    if document.get("schema") != SCHEMA:
        raise DataError(
            f"{source}: expected a camera path of schema {SCHEMA}, found {document.get('schema')}.",
            "Write it with the viewer of this version; docs/guides/render.md has its layout.",
        )
    fields = replace(JsonFields.of(document, source), remedy=LAYOUT)
    frames = tuple(_key_frame(item) for item in fields.objects("key_frames"))
    if not frames:
        raise DataError(f"{source} has no key frames.", "Add at least one in the viewer.")
    _check_moments([frame.seconds for frame in frames], source)
    if len({frame.time is None for frame in frames}) > 1:
        raise DataError(
            f"{source}: some of its key frames have a time, and others none.",
            "Give a time to every key frame, or null to all: they then have that of time=T.",
        )
    return CameraPath(
        frames,
        fps=fields.number("fps", FPS, 0.1, 1000.0),
        seconds=fields.number("seconds", SECONDS, 0.0, MOST_SECONDS),
        closed=fields.flag("closed", default=False),
        width=int(fields.number("width", 0.0, 0.0, LARGEST_SIDE)),
        height=int(fields.number("height", 0.0, 0.0, LARGEST_SIDE)),
    )


def _check_moments(moments: Sequence[float | None], source: Path) -> None:
    given = [moment for moment in moments if moment is not None]
    ascending = all(first < second for first, second in pairwise(given))
    if given and (len(given) < len(moments) or not ascending):
        raise DataError(
            f"{source}: the seconds of its key frames do not ascend, or some have none.",
            "Give seconds to every key frame, in order, or to none.",
        )


def _key_frame(fields: JsonFields) -> KeyFrame:
    return KeyFrame(
        pose(fields, "camera_to_world"),
        fields.number("fov", low=0.1, high=179.0),
        fields.optional_number("time", 0.0, 1.0),
        fields.optional_number("seconds", 0.0, MOST_SECONDS),
    )


def path_frames(path: CameraPath, frames: int | None = None) -> PathFrames:
    """Every frame of a path of key frames.

    Args:
        path: the key frames.
        frames: number of frames; ``None``: as many as its seconds take.

    Raises:
        DataError: these are too many.
    """
    keys = path.key_frames
    knots = _knots(path)
    length = path.seconds if knots is None else float(knots[-1] - knots[0])
    count = max(round(length * path.fps), 1) if frames is None else frames
    if count > MOST_FRAMES:
        raise DataError(
            f"the path would have {count:,} frames: {length:g} s at {path.fps:g} per second.",
            f"Shorten it: at most {MOST_FRAMES:,} are rendered.",
        )
    spline = PoseSpline(torch.stack([key.camera_to_world for key in keys]), knots, path.closed)
    if knots is None:
        moments = spline.even_moments(count)
    else:
        # A closed path ends one frame before it is at its first key frame again.
        steps = torch.arange(count, dtype=torch.float64) / max(count - 1 + path.closed, 1)
        moments = torch.lerp(knots[0], knots[-1], steps)
    fovs = _looped([key.fov for key in keys], path)
    times = [key.time for key in keys if key.time is not None]
    return PathFrames(
        spline.at(moments),
        hermite(fovs[:, None], spline.knots, moments, path.closed)[:, 0].clamp(0.1, 179),
        interpolate(_looped(times, path), spline.knots, moments)
        if len(times) == len(keys)
        else None,
        path.fps,
        path.width,
        path.height,
    )


def _knots(path: CameraPath) -> Float64[Tensor, " knots"] | None:
    """The seconds of the key frames, and of the return to the first one.

    ``None`` for one speed. Where time passes, the camera may stand still: then every step takes
    equally long.
    """
    keys = path.key_frames
    moments = [key.seconds for key in keys if key.seconds is not None]
    if not moments:
        if len({key.time for key in keys}) == 1:
            return None
        count = len(keys) + path.closed
        return torch.linspace(0, path.seconds, count, dtype=torch.float64)
    if path.closed:
        # The way back takes what is left of the film, or as long as the other steps do.
        rest = path.seconds - moments[-1]
        usual = (moments[-1] - moments[0]) / max(len(moments) - 1, 1)
        moments.append(moments[-1] + (rest if rest > 0 else max(usual, 1.0)))
    return torch.tensor(moments, dtype=torch.float64)


def _looped(values: Sequence[float], path: CameraPath) -> Float64[Tensor, " knots"]:
    """Values of the key frames, the first again at the end of a closed path."""
    again = values[:1] if path.closed else []
    return torch.tensor([*values, *again], dtype=torch.float64)


def pose(fields: JsonFields, name: str) -> Float64[Tensor, "4 4"]:
    """A rigid transform of 4 x 4 (or 3 x 4) numbers, in rows or in one list.

    Raises:
        DataError: it is none.
    """
    values = fields.numbers_of(name, ((4, 4), (3, 4), (16,), (12,)))
    found = torch.eye(4, dtype=torch.float64)
    found[:3] = torch.from_numpy(values).reshape(-1, 4)[:3]
    rotation = found[:3, :3]
    # Files hold rounded numbers, and some tools scale: the rotation is the nearest one.
    left, sizes, right = torch.linalg.svd(rotation)
    if not (float(sizes[0] - sizes[2]) < SKEW * float(sizes[0]) and float(rotation.det()) > 0):
        raise fields.refuse(name, "a rotation and a position, from the camera to the world")
    found[:3, :3] = left @ right
    return found
