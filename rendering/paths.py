"""RenderPath: cameras and times of the frames of a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.evaluation import render_model
from gsfw.core.maths.camera_path import at_times, orbit
from gsfw.plugins.registry import did_you_mean
from gsfw.plugins.run_source import is_dynamic
from gsfw.rendering.film import write_image
from gsfw.rendering.trails import Trails, make_trails, surface_settings

if TYPE_CHECKING:
    from gsfw.plugins.compose import Composition


@dataclass(frozen=True)
class FilmRule:
    """The user's choices for all films."""

    frames: int
    """Number of frames of each film."""
    scale: float
    """Size of the frames, relative to the training images."""
    time: float
    """Time of an orbit at one time, in [0, 1]."""
    camera: str
    """Name of the view that a film over time is rendered from; empty: the first held-out one."""


@dataclass(frozen=True)
class RenderPath:
    """The frames of a film, in order."""

    name: str
    """Name of the folder and of the film."""
    cameras: Cameras
    """One per frame, all of one size; with the time of each frame, unless the data has none."""


def paths(composition: Composition, what: str, rule: FilmRule) -> list[RenderPath]:
    """The paths for ``what``; ``all`` is the orbit, and the paths over time of a dynamic model.

    Raises:
        ConfigError: time is to pass where there is none, or there is no such camera.
    """
    dynamic = is_dynamic(composition)
    makers: dict[str, Callable[[DataManager, FilmRule], Cameras]] = {"orbit": _orbit}
    if dynamic:
        makers |= {"time": _over_time, "orbit-time": _orbit_over_time}
    elif what in ("time", "orbit-time"):
        why = (
            f"method {composition.settings.method.name} is static"
            if composition.scene.is_dynamic
            else f"the data ({composition.scene.name}) has no times"
        )
        raise ConfigError(
            f"what={what}: {why}, so all frames would show the same moment.",
            "Render what=orbit or what=views.",
        )
    chosen = [name for name in makers if what in ("all", name)]
    data = composition.parts.data
    return [RenderPath(name, _sized(makers[name](data, rule), rule.scale)) for name in chosen]


def trails(path: RenderPath, composition: Composition, count: int, length: int) -> Trails | None:
    """Trails for the frames of a path; ``None`` where all frames show one time.

    Args:
        path: the frames.
        composition: the run.
        count: largest number of trails.
        length: number of frames that each reaches back.
    """
    if path.cameras.time is None or len(path.cameras.time.unique()) < 2:
        return None
    parts = composition.parts
    cameras, settings = path.cameras.to(parts.device), composition.plan.settings
    return make_trails(parts.model, parts.rasterizer, cameras, settings, count, length)


def frames(
    path: RenderPath, composition: Composition, folder: Path, trails: Trails | None = None
) -> Iterator[Path]:
    """Render and write the frames, one at a time; their files."""
    parts, settings = composition.parts, composition.plan.settings
    if trails is not None:
        settings = surface_settings(parts.rasterizer, settings)
    cameras = path.cameras.to(parts.device)
    for index in range(len(cameras)):
        camera = cameras.select([index])
        time = None if camera.time is None else camera.time[0]
        output = render_model(parts.model, parts.rasterizer, camera, settings, time)
        image = output.color[0]
        if trails is not None:
            depth = None if output.depth is None else output.depth[0]
            image = trails.draw_on(image, depth, camera, index)
        yield write_image(folder / f"{index:04d}.png", image)


def _orbit(data: DataManager, rule: FilmRule) -> Cameras:
    """A circle around the scene, at one time."""
    views = data.views(Split.TRAIN).cameras
    cameras = orbit(Cameras.cat([_like(camera, views[0]) for camera in views]), rule.frames)
    return at_times(cameras, [rule.time] * rule.frames) if data.scene.is_dynamic else cameras


def _over_time(data: DataManager, rule: FilmRule) -> Cameras:
    """One camera that stands still, from the first time to the last."""
    return at_times(find_camera(data, rule.camera), _all_times(rule))


def _orbit_over_time(data: DataManager, rule: FilmRule) -> Cameras:
    """A circle around the scene while time passes."""
    return at_times(_orbit(data, rule), _all_times(rule))


def _all_times(rule: FilmRule) -> list[float]:
    """From 0 to 1, both of them shown."""
    return [index / max(rule.frames - 1, 1) for index in range(rule.frames)]


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
            f"The {len(known)} views are {min(known)} to {max(known)}.",
        )
    return known[name]


def _sized(cameras: Cameras, scale: float) -> Cameras:
    width, height = (max(round(side * scale), 1) for side in (cameras.width, cameras.height))
    return cameras.resized(width, height)


def _like(camera: Cameras, first: Cameras) -> Cameras:
    """Where a camera is, with the first one's lens and size: mixed sets have one orbit too."""
    return replace(first, world_to_camera=camera.world_to_camera)
