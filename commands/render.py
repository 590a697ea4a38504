"""`gsfw render RUN`: images of a trained model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.interface.arguments import RunOptions, read
from gsfw.rendering.film import VideoFormat

if TYPE_CHECKING:
    from gsfw.plugins.restore import Restored

MOST_FPS = 1000
"""Highest frame rate: a WebP counts in milliseconds."""


@dataclass(kw_only=True)
class RenderOptions(RunOptions):
    """Render the held-out views, an orbit and the passing of time, as PNG and as a film."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw render latest",
        "gsfw render runs/first what=orbit frames=120 scale=2 out=orbit",
        "gsfw render runs/moving what=time camera=eval_003 frames=150 fps=30 video=mp4",
        "gsfw render runs/moving what=time tracks=true",
    )

    what: Literal["all", "views", "orbit", "time", "orbit-time"] = "all"
    """Content: views (held out, beside their photos), orbit (around the scene at one time),
    time (from one camera, from first to last time), orbit-time (both at once), or all. A model
    file has no photos: views then needs data=PATH."""
    out: str = ""
    """Folder for the images. Empty: renders/ in the run, or beside the model file."""
    frames: int = 60
    """Number of frames of each film."""
    scale: float = 1.0
    """Size of the frames, relative to the images the run was trained on."""
    time: float = 0.0
    """Time of the orbit, in [0, 1]; a static model ignores it."""
    camera: str = ""
    """Name of the view whose camera what=time looks through. Empty: the first held-out one."""
    fps: int = 20
    """Frames per second of the films."""
    tracks: bool = False
    """Draw the paths of some Gaussians over the last frames, in what=time and orbit-time."""
    tracks_count: int = 150
    """Number of paths, of well-spread Gaussians."""
    tracks_frames: int = 12
    """Number of frames that each path reaches back."""
    video: VideoFormat = "auto"
    """Films beside the frames: mp4 (pip install 'gsfw[video]'), webp, none, or auto: mp4 if its
    encoder is installed, else webp."""


def run(arguments: list[str]) -> int:
    """Render, and print the place of the images."""
    options = read("render", RenderOptions, arguments)
    _check(options)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run, open_run
    from gsfw.core.loop.determinism import deterministic
    from gsfw.core.progress import stage, tracked
    from gsfw.plugins.registry import installed
    from gsfw.rendering.film import choose_format, write_film
    from gsfw.rendering.paths import FilmRule, frames, paths, trails

    chosen = choose_format(options.video)
    console = Console(options.json)
    found = find_run(options.run, console.say)
    restored = open_run(found, installed(), options.changed())
    composition = restored.composition
    rule = FilmRule(options.frames, options.scale, options.time, options.camera)
    asked = paths(composition, options.what, rule)
    out = Path(options.out) if options.out else found.folder.path / "renders"
    written: list[Path] = []
    films: list[Path] = []
    with deterministic(composition.parts.device):
        if options.what == "views" or (options.what == "all" and composition.parts.data.has_images):
            written += tracked(
                _views(restored, out / "views"), "rendering views", _count_views(restored)
            )
        for path in asked:
            lines = (
                trails(path, composition, options.tracks_count, options.tracks_frames)
                if options.tracks
                else None
            )
            rendered = frames(path, composition, out / path.name, lines)
            files = list(tracked(rendered, f"rendering {path.name}", options.frames))
            with stage(f"writing the film of {path.name}"):
                films += write_film(out / path.name, files, options.fps, chosen)
            written += files
    console.say(f"{len(written)} images in {out}")
    for film in films:
        console.say(f"film: {film}")
    written += films
    console.result({"run": found.name, "written": [str(path) for path in written]})
    return 0


def _check(options: RenderOptions) -> None:
    """Refuse invalid numbers before anything is loaded."""
    from gsfw.core.errors import ConfigError

    sound = options.frames >= 1 and 1 <= options.fps <= MOST_FPS
    if not (sound and options.scale > 0 and 0 <= options.time <= 1):
        raise ConfigError(
            f"frames={options.frames} scale={options.scale:g} time={options.time:g} "
            f"fps={options.fps}: expected at least 1 frame, a scale above 0, a time in [0, 1], "
            f"and 1 to {MOST_FPS} frames per second."
        )
    if options.tracks_count < 1 or options.tracks_frames < 1:
        raise ConfigError(
            f"tracks_count={options.tracks_count} tracks_frames={options.tracks_frames}: "
            "expected numbers of at least 1."
        )
    if options.tracks and options.what in ("views", "orbit"):
        raise ConfigError(
            f"tracks=true what={options.what}: nothing moves there.",
            "Render what=time or what=orbit-time.",
        )


def _count_views(restored: Restored) -> int:
    from gsfw.core.datamanager import Split

    return len(restored.composition.parts.data.views(Split.EVAL))


def _views(restored: Restored, folder: Path) -> Iterator[Path]:
    """Render every held-out view, the photo at the left and the render at the right."""
    import torch

    from gsfw.core.datamanager import Split
    from gsfw.core.loop.evaluation import render_model
    from gsfw.rendering.film import write_image

    parts, settings = restored.composition.parts, restored.composition.plan.settings
    assert settings.background is not None
    for index, name in enumerate(parts.data.views(Split.EVAL).names):
        (batch,) = parts.data.load(Split.EVAL, [index], parts.device)
        output = render_model(parts.model, parts.rasterizer, batch.cameras, settings, batch.time)
        both = torch.cat([batch.target(settings.background)[0], output.color[0]], dim=1)
        # Numbered and flat: names of the data may be absolute, lead elsewhere, or be equal.
        stem = f"{index:04d}_{Path(name).stem}"
        yield write_image(folder / f"{stem}.png", both)
        for kind, image in parts.method.view_images(batch, output).items():
            yield write_image(folder / f"{stem}_{kind}.png", image)
