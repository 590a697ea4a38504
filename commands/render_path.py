"""RenderPath: what `gsfw render` draws frame by frame: from where, and when."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.commands.film import write_picture
from gsfw.commands.trails import Trails, make_trails, surface_settings
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.evaluation import draw
from gsfw.core.maths.camera_path import at_times, orbit
from gsfw.plugins.registry import did_you_mean

if TYPE_CHECKING:
    from gsfw.commands.render import RenderOptions
    from gsfw.plugins.compose import Composition


@dataclass(frozen=True)
class RenderPath:
    """Frames in order."""

    name: str
    """Of their folder and of the film."""
    cameras: Cameras
    """One per frame, all of one size; with the time of each frame, unless the data has none."""


def is_dynamic(composition: Composition) -> bool:
    """Whether the model may look different at another time."""
    return composition.scene.is_dynamic and "static" not in composition.settings.method.tags


def paths(composition: Composition, options: RenderOptions) -> list[RenderPath]:
    """What was asked for; ``all`` is the orbit, and what moves in time where something does.

    Raises:
        ConfigError: time is to pass where there is none, or there is no such camera.
    """
    dynamic = is_dynamic(composition)
    makers: dict[str, Callable[[DataManager, RenderOptions], Cameras]] = {"orbit": _orbit}
    if dynamic:
        makers |= {"time": _over_time, "orbit-time": _orbit_over_time}
    elif options.what in ("time", "orbit-time"):
        why = (
            f"method {composition.settings.method.name} is static"
            if composition.scene.is_dynamic
            else f"the data ({composition.scene.name}) has no times"
        )
        raise ConfigError(
            f"what={options.what}: {why}, so all frames would show the same moment.",
            "Draw what=orbit or what=views.",
        )
    chosen = [name for name in makers if options.what in ("all", name)]
    data = composition.parts.data
    return [RenderPath(name, _sized(makers[name](data, options), options.scale)) for name in chosen]


def trails(path: RenderPath, composition: Composition, options: RenderOptions) -> Trails | None:
    """What tracks=true draws on the frames of a path on which time passes."""
    moves = path.cameras.time is not None and len(path.cameras.time.unique()) > 1
    if not (options.tracks and moves):
        return None
    parts = composition.parts
    return make_trails(
        parts.model,
        parts.rasterizer,
        path.cameras.to(parts.device),
        composition.plan.settings,
        options.tracks_count,
        options.tracks_frames,
    )


def frames(
    path: RenderPath, composition: Composition, folder: Path, trails: Trails | None = None
) -> Iterator[Path]:
    """Draw and write the frames, one at a time; their files."""
    parts, settings = composition.parts, composition.plan.settings
    if trails is not None:
        settings = surface_settings(parts.rasterizer, settings)
    cameras = path.cameras.to(parts.device)
    for index in range(len(cameras)):
        camera = cameras.select([index])
        time = None if camera.time is None else camera.time[0]
        output = draw(parts.model, parts.rasterizer, camera, settings, time)
        picture = output.color[0]
        if trails is not None:
            depth = None if output.depth is None else output.depth[0]
            picture = trails.draw_on(picture, depth, camera, index)
        yield write_picture(folder / f"{index:04d}.png", picture)


def _orbit(data: DataManager, options: RenderOptions) -> Cameras:
    """A circle around the scene, at one time."""
    views = data.views(Split.TRAIN).cameras
    cameras = orbit(Cameras.cat([_like(camera, views[0]) for camera in views]), options.frames)
    return at_times(cameras, [options.time] * options.frames) if data.scene.is_dynamic else cameras


def _over_time(data: DataManager, options: RenderOptions) -> Cameras:
    """One camera that stands still, from the first time to the last."""
    return at_times(find_camera(data, options.camera), _all_times(options))


def _orbit_over_time(data: DataManager, options: RenderOptions) -> Cameras:
    """A circle around the scene while time passes."""
    return at_times(_orbit(data, options), _all_times(options))


def _all_times(options: RenderOptions) -> list[float]:
    """From 0 to 1, both of them shown."""
    return [index / max(options.frames - 1, 1) for index in range(options.frames)]


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
