"""RenderPath: cameras and times of the frames of a film."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras, resized_by
from gsfw.core.datamanager import DataManager, Split, spread
from gsfw.core.errors import ConfigError
from gsfw.core.maths.camera_path import at_times, orbit, posed, spiral
from gsfw.plugins.registry import did_you_mean
from gsfw.plugins.run_source import is_dynamic
from gsfw.rendering.path_files import read_path_file
from gsfw.rendering.splines import PoseSpline

if TYPE_CHECKING:
    from gsfw.plugins.compose import Composition

FRAMES, FPS = 60, 20
"""Length and speed of a film, unless the user or a file of key frames says otherwise."""

FRAMES_PER_VIEW = 4
"""A path passes one view in so many frames: handheld captures shake from view to view."""

MOST_VIEWS = 64
"""Most views that a path passes."""

LEAST_VIEWS, RANDOM_STEP = 8, 0.85
"""Views in random order are as far from the next one as from any (1.0); those of captures, from so
many views on, are much nearer to it. Few views are far apart in any order."""

WITH_TIME = "-time"
"""End of the names of the paths along which time passes too."""


@dataclass(frozen=True)
class FilmRule:
    """The user's choices for all films."""

    frames: int | None = None
    """Number of frames of each film; ``None``: ``FRAMES``, or as a file says."""
    scale: float = 1.0
    """Size of the frames, relative to the training images."""
    width: int = 0
    """Width of the frames, in pixels; 0: by ``scale``."""
    time: float = 0.0
    """Time of a film at one time, in [0, 1]."""
    camera: str = ""
    """Name of the view that a film over time is rendered from, the first held-out one if empty; or
    a file of a camera path."""

    @property
    def file(self) -> Path | None:
        """The file of a camera path; ``None`` if there is none."""
        return Path(self.camera) if self.camera.lower().endswith(".json") else None

    @property
    def count(self) -> int:
        """Number of frames, unless a file says otherwise."""
        return FRAMES if self.frames is None else self.frames


@dataclass(frozen=True)
class RenderPath:
    """The frames of a film, in order."""

    name: str
    """Name of the folder and of the film."""
    cameras: Cameras
    """One per frame, all of one size; with the time of each frame, unless the data has none."""
    fps: int | float = FPS
    """Frames per second, unless the user says otherwise."""


MAKERS: dict[str, Callable[[DataManager, FilmRule], Cameras]] = {
    "orbit": lambda data, rule: orbit(alike(_train(data)), rule.count),
    "path": lambda data, rule: _through_views(data, rule.count),
    "spiral": lambda data, rule: spiral(alike(_train(data)), rule.count),
}
"""Cameras of each path, without times."""

PATHS = (*MAKERS, "time", *(name + WITH_TIME for name in MAKERS))
"""Names of all paths."""


def paths(composition: Composition, what: str, rule: FilmRule) -> list[RenderPath]:
    """The paths for ``what``; ``all`` is the orbit, and the paths over time of a dynamic model.

    A file of a camera path is the only path.

    Raises:
        ConfigError: time is to pass where there is none, or there is no such camera.
        DataError: the file of a camera path cannot be used.
    """
    moves, data = is_dynamic(composition), composition.parts.data
    if not moves:
        _check_still(composition, what, rule)
    if rule.file is not None:
        return [_of_file(rule.file, data, rule)]
    names = [what]
    if what == "all":
        names = ["orbit", "time", "orbit-time"] if moves else ["orbit"]
    elif what == "views":
        names = []
    return [RenderPath(name, _sized(_cameras(name, data, rule), rule)) for name in names]


def _check_still(composition: Composition, what: str, rule: FilmRule) -> None:
    """Refuse what needs a model that changes with time.

    Raises:
        ConfigError: names the option.
    """
    why = (
        f"method {composition.settings.method.name} is static"
        if composition.scene.is_dynamic
        else f"the data ({composition.scene.name}) has no times"
    )
    if what == "time" or what.endswith(WITH_TIME):
        raise ConfigError(
            f"what={what}: {why}, so all frames would show the same moment.",
            "Render what=orbit or what=views.",
        )
    if rule.time:
        raise ConfigError(
            f"time={rule.time:g}: {why}, so every time shows the same.", "Leave time out."
        )
    if rule.camera and rule.file is None:
        raise ConfigError(
            f"camera={rule.camera}: {why}, and only what=time renders from the camera of a view.",
            "Leave camera out, or give it the file of a camera path.",
        )


def _cameras(name: str, data: DataManager, rule: FilmRule) -> Cameras:
    """The cameras of a path, with their times."""
    if name == "time":
        return at_times(find_camera(data, rule.camera), _all_times(rule))
    cameras = MAKERS[name.removesuffix(WITH_TIME)](data, rule)
    if not data.scene.is_dynamic:
        return cameras
    times = _all_times(rule) if name.endswith(WITH_TIME) else [rule.time] * rule.count
    return at_times(cameras, times)


def _of_file(file: Path, data: DataManager, rule: FilmRule) -> RenderPath:
    """The frames of a camera path, in the scene frame; pinhole cameras."""
    found = read_path_file(file, rule.frames)
    if rule.time and found.times is not None:
        raise ConfigError(
            f"time={rule.time:g} camera={file}: each frame of this path has a time of its own.",
            "Leave time out.",
        )
    like = _train(data)[0]
    width, height = found.width or like.width, found.height or like.height
    if not (found.width and found.height):
        width, height = like.width, like.height
    poses = data.scene.world_from_scene.inverse().camera(torch.linalg.inv(found.camera_to_world))
    cameras = replace(posed(like, poses), width=width, height=height, model=CameraModel.PINHOLE)
    focal = height / 2 / (found.fovs * (math.pi / 360)).tan()
    intrinsics = torch.zeros(len(focal), 3, 3, dtype=torch.float64)
    intrinsics[:, 0, 0] = intrinsics[:, 1, 1] = focal
    intrinsics[:, 0, 2], intrinsics[:, 1, 2], intrinsics[:, 2, 2] = width / 2, height / 2, 1.0
    cameras = replace(cameras, intrinsics=intrinsics.to(like.intrinsics))
    if data.scene.is_dynamic:
        fixed = [rule.time] * len(cameras)
        cameras = at_times(cameras, fixed if found.times is None else found.times.tolist())
    return RenderPath(file.stem, _sized(cameras, rule), found.fps or FPS)


def _through_views(data: DataManager, frames: int) -> Cameras:
    """A smooth path through the views, in the order of their names, each place once."""
    named = [
        (name, camera)
        for split in Split
        for name, camera in zip(data.views(split).names, data.views(split).cameras, strict=True)
    ]
    ordered = [camera for name, camera in sorted(named, key=lambda view: _by_number(view[0]))]
    poses: list[torch.Tensor] = []
    for camera in ordered:
        pose = camera.world_to_camera[0].double()
        if not any(torch.allclose(pose, known, atol=1e-6) for known in poses):
            poses.append(pose)
    ordered_poses = in_turn(torch.linalg.inv(torch.stack(poses)))
    most = min(max(frames // FRAMES_PER_VIEW, 2), MOST_VIEWS)
    spline = PoseSpline(ordered_poses[list(spread(range(len(poses)), most))])
    found = torch.linalg.inv(spline.at(spline.even_moments(frames)))
    return posed(_train(data)[0], found)


def in_turn(poses: Float64[Tensor, "k 4 4"]) -> Float64[Tensor, "k 4 4"]:
    """Camera-to-world poses in an order without jumps.

    As they are, unless their order is as good as random, as in NeRF's Blender scenes: then each is
    followed by the nearest one that is left.
    """
    centers = poses[:, :3, 3]
    distances = torch.cdist(centers, centers)
    count = len(poses)
    step = distances.diagonal(1).mean()
    mean = distances.sum() / max(count * (count - 1), 1)
    if count < LEAST_VIEWS or float(step) < RANDOM_STEP * float(mean):
        return poses
    order, left = [0], set(range(1, count))
    while left:
        row = distances[order[-1]].tolist()
        order.append(min(left, key=row.__getitem__))
        left.remove(order[-1])
    return poses[order]


def _by_number(name: str) -> list[tuple[int, str]]:
    """Sorts names as people count: 2.jpg before 10.jpg."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _all_times(rule: FilmRule) -> list[float]:
    """Times from 0 to 1, with both ends."""
    return [index / max(rule.count - 1, 1) for index in range(rule.count)]


def find_camera(data: DataManager, name: str) -> Cameras:
    """The camera of a view that is named; the first held-out one (or first of all) for "".

    Raises:
        ConfigError: no view has this name.
    """
    known: dict[str, Cameras] = {}
    for split in (Split.EVAL, Split.TRAIN):
        views = data.views(split)
        for view, camera in zip(views.names, views.cameras, strict=True):
            known.setdefault(view, camera)
    if not name:
        return next(iter(known.values()))
    if name not in known:
        raise ConfigError(
            f"camera={name}: no view has this name.{did_you_mean(name, known)}",
            f"The {len(known)} views are {min(known)} to {max(known)}. A file of a camera path "
            "ends in .json.",
        )
    return known[name]


def _sized(cameras: Cameras, rule: FilmRule) -> Cameras:
    return resized_by(cameras, rule.width / cameras.width if rule.width else rule.scale)


def _train(data: DataManager) -> tuple[Cameras, ...]:
    return data.views(Split.TRAIN).cameras


def alike(cameras: Iterable[Cameras]) -> Cameras:
    """All places of cameras, with the first one's lens and size: mixed sets have one orbit too."""
    first, *others = cameras
    like = [replace(first, world_to_camera=other.world_to_camera) for other in others]
    return Cameras.cat([first, *like])
