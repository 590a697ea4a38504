"""`gsfw render RUN`: images and films of a trained model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os.path import commonpath
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.interface.arguments import DetailOptions, RunOptions, positional, read_options
from gsfw.core.ranges import number
from gsfw.rendering.film import VideoFormat

if TYPE_CHECKING:
    from gsfw.rendering.request import RenderRequest


@dataclass(kw_only=True)
class RenderOptions(RunOptions, DetailOptions):
    """Render views, camera paths and changes over time, as images and films."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw render latest",
        "gsfw render latest what=views channel=photo,color,error",
        "gsfw render latest what=path channel=color,depth frames=120",
        "gsfw render latest what=orbit frames=120 width=1920 out=orbit",
        "gsfw render latest camera=path.json",
        "gsfw render runs/moving what=time camera=eval_003 frames=150 fps=30 video=mp4",
        "gsfw render runs/moving what=orbit-time channel=color,motion",
        "gsfw render runs/moving what=time tracks=true",
        "gsfw render latest budget=200000",
    )

    run: str = positional("RUN")
    """A run folder, a checkpoint, a model file (.gsfw), a splat file of any format, or latest."""
    what: Literal[
        "all", "views", "orbit", "path", "spiral", "time", "orbit-time", "path-time", "spiral-time"
    ] = "all"
    """Content: views (held out, beside their photos), orbit (around the scene at one time), path
    (smoothly through the views in their order), spiral (from low to high), time (from one camera,
    from first to last time), orbit-time, path-time and spiral-time (both at once), or all: views,
    orbit, time and orbit-time. A model file has no photos: views then needs data=PATH."""
    split: Literal["eval", "train", "all"] = "eval"
    """Views of what=views and what=all: held-out ones, those that were trained on, or all."""
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
    """Folder for the images and films. Empty: renders/ in the run, or beside the model file."""
    frames: int | None = None
    """Number of frames of each film. None: 60, or as the file of a camera path says."""
    fps: int | None = None
    """Frames per second of the films. None: 20, or as the file of a camera path says."""
    scale: float = number(1.0, above=0, below=math.inf)
    """Size of the frames of films, relative to the images the run was trained on."""
    width: int = number(0, at_least=0)
    """Width of the frames of films in pixels, of one eye of stereo, in place of scale. 0: by
    scale."""
    time: float = number(0.0, at_least=0, at_most=1)
    """Time of films at one time, in [0, 1], of a model that changes with time."""
    camera: str = ""
    """Name of the view whose camera what=time looks through (empty: the first held-out one), or a
    file of a camera path: of gsfw's viewer, nerfstudio's camera_path.json, or a transforms.json."""
    projection: Literal["camera", "stereo", "panorama"] = "camera"
    """camera: one image; stereo: two eyes, side by side; panorama: for 360-degree players."""
    eye_distance: float = number(0.0, at_least=0, below=math.inf)
    """Distance between the eyes of stereo, in scene units. 0: 1/30 of the viewing distance."""
    tracks: bool = False
    """Draw the paths of some Gaussians over the last frames, where time passes."""
    tracks_count: int = number(150, at_least=1)
    """Number of paths, of well-spread Gaussians."""
    tracks_frames: int = number(12, at_least=1)
    """Number of frames that each path reaches back."""
    images: Literal["png", "png16", "jpg", "exr"] = "png"
    """Files of the frames: png, png16 (16 bits per colour), jpg, or exr (the values of all
    channels as float32, and no film)."""
    video: VideoFormat = "auto"
    """Films beside the frames: mp4 or webm (pip install 'gsfw[video]'), webp, none, or auto: mp4 if
    its encoder is installed, else webp."""


def run(arguments: list[str]) -> int:
    """Render, and print the place of the images."""
    options = read_options("render", RenderOptions, arguments)
    from gsfw.commands.interface.progress import load_torch
    from gsfw.commands.interface.render_rules import check_channels, check_options

    check_options(options)
    detail = options.drawn()
    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run, restore_run, warn_of_file
    from gsfw.commands.interface.splats_alone import or_splats_alone
    from gsfw.plugins.registry import installed
    from gsfw.rendering.film import INSTALLATION
    from gsfw.rendering.request import render

    check_channels(options)
    request = render_request(options)
    request.check()
    console = Console(options.json)
    found = find_run(options.run, console.say, splats=True)
    if options.what != "views":  # Those need the photos.
        found = or_splats_alone(found, options.data, None, console.warn)
    restored = restore_run(found, installed(), options.changed(), detail=detail)
    composition = restored.composition
    warn_of_file(found, composition, console)
    out = Path(options.out) if options.out else found.folder.path / "renders"
    images, films = render(composition, request, out, console.say)
    folder = Path(commonpath([image.parent for image in images])) if images else out
    console.say(f"{len(images)} images in {folder}")
    for film in films:
        is_stand_in = options.video == "auto" and film.suffix == ".webp"
        console.say(f"film: {film}{f' (mp4: {INSTALLATION})' if is_stand_in else ''}")
    console.result({"run": found.name, "written": [str(file) for file in images + films]})
    return 0


def render_request(options: RenderOptions) -> RenderRequest:
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
