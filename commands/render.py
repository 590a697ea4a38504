"""`gsfw render RUN`: images and films of a trained model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.interface.arguments import RunOptions, read, word
from gsfw.rendering.film import VideoFormat

if TYPE_CHECKING:
    from gsfw.rendering.request import RenderRequest

MOST_FPS = 1000
"""Highest frame rate: a WebP counts in milliseconds."""


@dataclass(kw_only=True)
class RenderOptions(RunOptions):
    """Render views, camera paths and the passing of time, as images and as films."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw render latest",
        "gsfw render latest what=views channel=photo,color,error",
        "gsfw render latest what=path channel=color,depth frames=120",
        "gsfw render latest what=orbit frames=120 width=1920 out=orbit",
        "gsfw render latest camera=path.json",
        "gsfw render runs/moving what=time camera=eval_003 frames=150 fps=30 video=mp4",
        "gsfw render runs/moving what=orbit-time channel=color,motion",
        "gsfw render runs/moving what=time tracks=true",
    )

    run: str = word("RUN")
    """A run folder, a checkpoint, a model file (.gsfw), a splat file (.ply), or latest."""
    what: Literal[
        "all", "views", "orbit", "path", "spiral", "time", "orbit-time", "path-time", "spiral-time"
    ] = "all"
    """Content: views (held out, beside their photos), orbit (around the scene at one time), path
    (smoothly through the views in their order), spiral (from low to high), time (from one camera,
    from first to last time), orbit-time, path-time and spiral-time (both at once), or all: views,
    orbit, time and orbit-time. A model file has no photos: views then needs data=PATH."""
    split: Literal["eval", "train", "all"] = "eval"
    """Views of what=views: held-out ones, those that were trained on, or all."""
    channel: tuple[str, ...] = ()
    """Images side by side: color, photo, depth, alpha, normals, error, contribution, count,
    sh_degree, motion. Empty: photo,color for views, color for films."""
    colormap: Literal[
        "auto", "turbo", "viridis", "magma", "inferno", "plasma", "cividis", "gray"
    ] = "auto"
    """Colours of values, such as depth. auto: those that suit the channel."""
    range: tuple[float, ...] = ()
    """Values at the two ends of the colours: range=LOW,HIGH. Empty: found, and the same for all
    frames of a film."""
    bars: bool = True
    """Draw a colour bar beside each channel of values."""
    labels: bool = True
    """Write the names of the channels, where there are several."""
    background: str = ""
    """Colour behind the scene: white, black, or r,g,b in [0, 1]. Empty: that of the training."""
    out: str = ""
    """Folder for the images. Empty: renders/ in the run, or beside the model file."""
    frames: int | None = None
    """Number of frames of each film. None: 60, or as the file of a camera path says."""
    fps: int | None = None
    """Frames per second of the films. None: 20, or as the file of a camera path says."""
    scale: float = 1.0
    """Size of the frames, relative to the images the run was trained on."""
    width: int = 0
    """Width of the frames in pixels, in place of scale. 0: by scale."""
    time: float = 0.0
    """Time of films at one time, in [0, 1]; a static model ignores it."""
    camera: str = ""
    """Name of the view whose camera what=time looks through (empty: the first held-out one), or a
    file of a camera path: of gsfw's viewer, nerfstudio's camera_path.json, or a transforms.json."""
    projection: Literal["camera", "stereo", "panorama"] = "camera"
    """One image; those of two eyes, side by side; or all directions, for 360-degree players."""
    eye_distance: float = 0.0
    """Distance of the eyes of stereo, in scene units. 0: 1/30 of that of what is looked at."""
    tracks: bool = False
    """Draw the paths of some Gaussians over the last frames, where time passes."""
    tracks_count: int = 150
    """Number of paths, of well-spread Gaussians."""
    tracks_frames: int = 12
    """Number of frames that each path reaches back."""
    images: Literal["png", "png16", "jpg", "exr"] = "png"
    """Files of the frames: png, png16 (16 bits per colour), jpg, or exr (the values of all
    channels as float32, and no film)."""
    video: VideoFormat = "auto"
    """Films beside the frames: mp4 or webm (pip install 'gsfw[video]'), webp, none, or auto: mp4 if
    its encoder is installed, else webp."""


def run(arguments: list[str]) -> int:
    """Render, and print the place of the images."""
    options = read("render", RenderOptions, arguments)
    _check(options)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run, open_run
    from gsfw.plugins.registry import installed
    from gsfw.rendering.request import render

    _check_channels(options)
    request = _request(options)
    request.check()
    console = Console(options.json)
    found = find_run(options.run, console.say, splats=True)
    composition = open_run(found, installed(), options.changed()).composition
    out = Path(options.out) if options.out else found.folder.path / "renders"
    images, films = render(composition, request, out, console.say)
    console.say(f"{len(images)} images in {out}")
    for film in films:
        console.say(f"film: {film}")
    console.result({"run": found.name, "written": [str(file) for file in images + films]})
    return 0


def _check(options: RenderOptions) -> None:
    """Refuse invalid settings before anything is loaded."""
    from gsfw.core.background import parse_background
    from gsfw.core.errors import ConfigError

    frames = 1 if options.frames is None else options.frames
    fps = 1 if options.fps is None else options.fps
    sound = frames >= 1 and 1 <= fps <= MOST_FPS
    if not (sound and options.scale > 0 and 0 <= options.time <= 1):
        raise ConfigError(
            f"frames={frames} scale={options.scale:g} time={options.time:g} "
            f"fps={fps}: expected at least 1 frame, a scale above 0, a time in [0, 1], "
            f"and 1 to {MOST_FPS} frames per second."
        )
    if options.width < 0 or (options.width and options.scale != 1):
        raise ConfigError(
            f"width={options.width} scale={options.scale:g}: expected one of them, above 0.",
            "Leave one of them out.",
        )
    if options.range and (len(options.range) != 2 or not options.range[0] < options.range[1]):
        raise ConfigError(
            f"range={','.join(f'{end:g}' for end in options.range)}: expected two numbers, the "
            "smaller one first.",
            "Write range=LOW,HIGH, such as range=0,5.",
        )
    if options.background:
        parse_background(options.background)
    if options.eye_distance < 0:
        raise ConfigError(f"eye_distance={options.eye_distance:g}: expected 0 or more.")
    if options.images == "exr" and options.video not in ("auto", "none"):
        raise ConfigError(
            f"images=exr video={options.video}: a film is made of pictures, and an EXR holds "
            "values.",
            "Render it twice: images=png for the film, into another folder with out=DIR.",
        )
    _check_tracks(options)


def _check_channels(options: RenderOptions) -> None:
    """Refuse channels that are not there, or of which a path has none."""
    from gsfw.core.errors import ConfigError
    from gsfw.rendering.channels import find_channel

    listed = [find_channel(name) for name in options.channel]
    has_file = options.camera.lower().endswith(".json")
    if has_file and options.what not in ("all", "path"):
        raise ConfigError(
            f"what={options.what} camera={options.camera}: the file has the whole path.",
            "Leave what out, or give camera the name of a view.",
        )
    with_photo = [channel.name for channel in listed if channel.needs_image]
    if with_photo and (has_file or options.what != "views"):
        raise ConfigError(
            f"channel={','.join(options.channel)}: {with_photo[0]} needs a photo, and there is "
            "none along a camera path.",
            f"Render what=views, or leave {with_photo[0]} out.",
        )
    if options.what == "views" and options.projection != "camera":
        raise ConfigError(
            f"what=views projection={options.projection}: views are compared with photos, which "
            "have one image.",
            "Render a camera path: what=orbit or what=path.",
        )


def _check_tracks(options: RenderOptions) -> None:
    from gsfw.core.errors import ConfigError

    if options.tracks_count < 1 or options.tracks_frames < 1:
        raise ConfigError(
            f"tracks_count={options.tracks_count} tracks_frames={options.tracks_frames}: "
            "expected numbers of at least 1."
        )
    if not options.tracks:
        return
    if options.what in ("views", "orbit", "path", "spiral"):
        raise ConfigError(
            f"tracks=true what={options.what}: nothing moves there.",
            "Render what=time or what=orbit-time.",
        )
    if options.projection != "camera" or (options.channel and "color" not in options.channel):
        raise ConfigError(
            "tracks=true: tracks are drawn on the colours of one camera.",
            "Leave projection out, and let channel have color.",
        )


def _request(options: RenderOptions) -> RenderRequest:
    """The options in the terms of the renderer."""
    from gsfw.core.datamanager import Split
    from gsfw.rendering.channels import find_channel
    from gsfw.rendering.frames import FrameRule
    from gsfw.rendering.paths import FilmRule
    from gsfw.rendering.pictures import PictureStyle
    from gsfw.rendering.request import RenderRequest

    panorama = options.projection == "panorama"
    style = PictureStyle(
        tuple(find_channel(name) for name in options.channel),
        "" if options.colormap == "auto" else options.colormap,
        (options.range[0], options.range[1]) if options.range else None,
        options.bars,
        options.labels,
    )
    width = options.width if panorama else 0
    return RenderRequest(
        what=options.what,
        splits=tuple(split for split in Split if options.split in (split.value, "all")),
        film=FilmRule(
            options.frames,
            options.scale,
            options.width - width,
            options.time,
            options.camera,
        ),
        frame=FrameRule(style, options.images, options.projection, options.eye_distance, width),
        background=options.background,
        tracks=(options.tracks_count, options.tracks_frames) if options.tracks else None,
        video=options.video,
        fps=options.fps,
    )
