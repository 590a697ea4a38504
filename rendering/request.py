"""RenderRequest: what is rendered of a run, and the rendering of all of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from gsfw.core.background import parse_background
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.determinism import deterministic
from gsfw.core.progress import stage, tracked
from gsfw.plugins.compose import Composition
from gsfw.plugins.run_source import is_dynamic
from gsfw.rendering.channels import CHANNELS, available_channels
from gsfw.rendering.film import VideoFormat, choose_format, write_film
from gsfw.rendering.frame_folder import FrameFolder
from gsfw.rendering.frames import FrameRenderer, FrameRule, film_frames, view_frames
from gsfw.rendering.paths import FilmRule, RenderPath, paths
from gsfw.rendering.trails import trails_along

VIEW_CHANNELS, FILM_CHANNELS = ("photo", "color"), ("color",)
"""Channels of views and of films, unless some are given."""

Say = Callable[[str], None]
"""Receives a line for the user."""


@dataclass(frozen=True)
class RenderRequest:
    """The images to render, and their form."""

    what: str
    """views, all, or the name of a path."""
    splits: tuple[Split, ...]
    """Splits whose views are rendered."""
    film: FilmRule
    frame: FrameRule
    """Form of the frames; with a style without channels these have their usual ones."""
    background: str = ""
    """Colour behind the scene; empty: that of the training."""
    tracks: tuple[int, int] | None = None
    """Number of trails, and of the frames that they reach back; ``None`` for none."""
    video: VideoFormat = "auto"
    fps: int | None = None
    """Frames per second; ``None``: as each path has it."""

    @property
    def video_format(self) -> VideoFormat:
        """The format of films; none where frames are no pictures.

        Raises:
            UnavailableError: there is no encoder for it.
        """
        return choose_format("none" if self.frame.images == "exr" else self.video)

    def check(self) -> None:
        """Refuse what this machine cannot do, before anything is loaded.

        Raises:
            UnavailableError: there is no encoder for the films.
        """
        _ = self.video_format


def render(
    composition: Composition, request: RenderRequest, out: Path, say: Say
) -> tuple[list[Path], list[Path]]:
    """Render all that is asked for; the images, and the films.

    Args:
        composition: the run.
        request: what and how.
        out: folder of the files.
        say: receives what was found of an earlier render.

    Raises:
        ConfigError: the run lacks what is asked for.
        OutputError: a file cannot be written; those before it are whole.
    """
    composition = _before(composition, request.background)
    asked = paths(composition, request.what, request.film)
    if request.tracks and not any(_passes_time(path) for path in asked):
        raise ConfigError(
            "tracks=true: all frames show one time, so that nothing moves.",
            "Render what=time of a model that changes with time, or leave tracks out.",
        )
    images: list[Path] = []
    films: list[Path] = []
    with deterministic(composition.parts.device):
        if _wants_views(composition, request):
            images += _views(composition, request, out, say)
        for path in asked:
            frames = _frames(composition, request, path, out, say)
            with stage(f"writing the film of {path.name}"):
                fps = request.fps or path.fps
                films += write_film(out / path.name, frames, fps, request.video_format)
            images += frames
    return images, films


def _passes_time(path: RenderPath) -> bool:
    """True if frames of a film show several times."""
    return path.cameras.time is not None and len(path.cameras.time.unique()) > 1


def _before(composition: Composition, background: str) -> Composition:
    """The run before another background."""
    if not background:
        return composition
    plan, method = composition.plan, composition.parts.method
    color = torch.tensor(
        parse_background(background, composition.scene.has_alpha), device=composition.parts.device
    )
    settings = method.render_settings(replace(plan.settings, background=color), None)
    return replace(composition, plan=replace(plan, settings=settings))


def _wants_views(composition: Composition, request: RenderRequest) -> bool:
    if request.film.file is not None:
        return False
    has_images = composition.parts.data.has_images
    return request.what == "views" or (request.what == "all" and has_images)


def _views(composition: Composition, request: RenderRequest, out: Path, say: Say) -> list[Path]:
    """Render the views of the splits; their files.

    Raises:
        ConfigError: views alone are asked for, and there are none.
    """
    data = composition.parts.data
    splits = [split for split in request.splits if len(data.views(split))]
    if not splits and request.what == "views":
        raise ConfigError(
            "what=views: this run has no held-out images to render.",
            "Render those it was trained on with split=train.",
        )
    renderer = _renderer(composition, request, VIEW_CHANNELS, has_photos=True)
    files: list[Path] = []
    for split in splits:
        folder = out / ("views" if split is Split.EVAL else f"views-{split.value}")
        frames, rendered = view_frames(split, renderer, folder)
        files += _gathered(frames, rendered, f"{split.value} views", say)
    return files


def _frames(
    composition: Composition, request: RenderRequest, path: RenderPath, out: Path, say: Say
) -> list[Path]:
    """Render the frames of one film; their files."""
    renderer = _renderer(composition, request, FILM_CHANNELS, has_photos=False)
    drawn = request.tracks
    trails = None if drawn is None else trails_along(path.cameras, composition, *drawn)
    if trails is not None and not len(trails):
        say(f"{path.name}: no tracks are drawn, as no Gaussian is opaque yet; train longer")
    frames, rendered = film_frames(path, renderer, out / path.name, trails, drawn or ())
    return _gathered(frames, rendered, path.name, say)


def _gathered(frames: FrameFolder, rendered: Iterator[Path], name: str, say: Say) -> list[Path]:
    """All files of a folder, with progress."""
    if frames.kept:
        say(f"{name}: {frames.kept} of {len(frames.names)} frames were rendered before")
    try:
        return list(tracked(rendered, f"rendering {name}", len(frames.names)))
    except KeyboardInterrupt:
        there = sum((frames.path / frame).is_file() for frame in frames.names)
        say(f"{name}: {there} of {len(frames.names)} frames are there; the same command continues")
        raise


def _renderer(
    composition: Composition, request: RenderRequest, usual: tuple[str, ...], has_photos: bool
) -> FrameRenderer:
    """Renders the given channels, or the usual ones; those that compare only where photos are.

    Raises:
        ConfigError: none is left, or one needs a model that changes with time.
    """
    style = request.frame.style
    known = available_channels(is_dynamic(composition), has_photos)
    asked = style.channels or tuple(CHANNELS[name] for name in usual)
    still = [channel.name for channel in asked if channel.moving and channel not in known]
    if still:
        raise ConfigError(
            f"channel={still[0]}: this model does not change with time.", "Leave this channel out."
        )
    shown = tuple(channel for channel in asked if channel in known)
    if not shown:
        raise ConfigError(
            f"channel={','.join(channel.name for channel in asked)}: there are no photos to "
            "compare with.",
            "Leave channel out, or render what=views.",
        )
    rule = replace(request.frame, style=replace(style, channels=shown))
    return FrameRenderer(composition, rule)
