"""Rules of `gsfw render`: which options go together, so that none is silently left out.

Every option is either honoured or refused with cause and remedy. What depends on the run (whether
it moves, whether it has photos) is refused where it is rendered (``rendering.request``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.core.background import parse_background
from gsfw.core.errors import ConfigError

if TYPE_CHECKING:
    from gsfw.commands.render import RenderOptions
    from gsfw.rendering.channels import Channel

MOST_FPS = 1000
"""Highest frame rate: a WebP counts in milliseconds."""

AT_ONE_TIME = ("orbit", "path", "spiral")
"""Paths along which only the camera moves."""

BEFORE_BACKGROUND = ("color", "photo", "error")
"""Channels that show the colour behind the scene."""


FILM_SUFFIXES = ("mp4", "webm", "webp", "gif", "mov", "mkv", "avi", "m4v")
"""Suffixes that a user who gives one wants a film for."""


@dataclass(frozen=True)
class Rule:
    """A condition of some options, where they are given."""

    options: tuple[str, ...]
    """Names of the options."""
    against: str
    """Name of the option that must suit them."""
    holds: Callable[[RenderOptions], bool]
    cause: str
    """The cause, as the end of a sentence."""
    remedy: str
    """Options to give, the beginning of "..., or leave OPTION out."."""


def _has_file(options: RenderOptions) -> bool:
    """True if a file has the camera path."""
    return options.camera.lower().endswith(".json")


def _has_views(options: RenderOptions) -> bool:
    return options.what in ("views", "all") and not _has_file(options)


RULES = (
    Rule(
        ("what",), "camera",
        lambda options: not _has_file(options) or options.what == "path",
        "the file has the whole path",
        "Give camera the name of a view",
    ),
    Rule(
        ("split",), "what",
        _has_views,
        "a camera path has no views of a split",
        "Render what=views",
    ),
    Rule(
        ("projection",), "what",
        lambda options: options.what != "views",
        "views are compared with photos, which have one image",
        "Render a camera path (what=orbit)",
    ),
    Rule(
        ("scale", "width"), "what",
        lambda options: options.what != "views",
        "views have the size of their photos",
        "Render a camera path (what=path)",
    ),
    Rule(
        ("frames", "fps", "video"), "what",
        lambda options: options.what != "views",
        "views are single images, and make no film",
        "Render a camera path (what=path)",
    ),
    Rule(
        ("video",), "images",
        lambda options: options.images != "exr",
        "a film is made of pictures, and an EXR holds values",
        "Render it twice: images=png for the film, into another folder with out=DIR",
    ),
    Rule(
        ("fps",), "images",
        lambda options: options.images != "exr",
        "EXR files make no film, and fps is the speed of a film",
        "Render images=png",
    ),
    Rule(
        ("fps",), "video",
        lambda options: options.video != "none",
        "there is no film, and fps is the speed of a film",
        "Render video=auto",
    ),
    Rule(
        ("time",), "what",
        lambda options: options.what in ("all", *AT_ONE_TIME),
        "every frame has a time of its own there",
        "Render a film at one time (what=orbit)",
    ),
    Rule(
        ("camera",), "what",
        lambda options: _has_file(options) or options.what in ("all", "time"),
        "only what=time renders from the camera of a view",
        "Render what=time",
    ),
    Rule(
        ("eye_distance",), "projection",
        lambda options: options.projection == "stereo",
        "only stereo has two eyes",
        "Render projection=stereo",
    ),
    Rule(
        ("tracks_count", "tracks_frames"), "tracks",
        lambda options: options.tracks,
        "no tracks are drawn",
        "Render tracks=true",
    ),
    Rule(
        ("tracks",), "what",
        lambda options: options.what not in ("views", *AT_ONE_TIME) or _has_file(options),
        "nothing moves there",
        "Render what=time or what=orbit-time",
    ),
    Rule(
        ("tracks",), "projection",
        lambda options: options.projection == "camera",
        "tracks are drawn on the image of one camera",
        "Leave projection out",
    ),
    Rule(
        ("tracks",), "channel",
        lambda options: not options.channel or "color" in options.channel,
        "tracks are drawn on the colours",
        "Add color to channel",
    ),
    Rule(
        ("colormap", "range"), "images",
        lambda options: options.images != "exr",
        "an EXR holds the values themselves, without colours",
        "Render images=png",
    ),
)  # fmt: skip
"""Rules that are checked before torch is loaded; of several broken ones the first is told."""

CHANNEL_RULES = (
    Rule(
        ("colormap", "range"), "channel",
        lambda options: any(channel.kind == "scalar" for channel in _shown(options)),
        "colour maps and ranges are for channels of values, and none is drawn",
        "Render channel=color,depth or another one of values",
    ),
    Rule(
        ("background",), "channel",
        lambda options: any(channel.name in BEFORE_BACKGROUND for channel in _shown(options)),
        "no channel shows what is behind the scene",
        "Add color to channel",
    ),
)  # fmt: skip
"""Rules on the kinds of the channels."""


def check_options(options: RenderOptions) -> None:
    """Refuse options that cannot be, or that do not go together, before torch is loaded.

    Raises:
        ConfigError: names the option, the cause and the remedy.
    """
    _check_numbers(options)
    _check_folder(options)
    _check_rules(options, RULES)


def _check_folder(options: RenderOptions) -> None:
    """Refuse the name of a film as the folder."""
    out = Path(options.out)
    form = out.suffix.lower().removeprefix(".")
    if form in FILM_SUFFIXES and not out.is_dir():
        video = form if form in ("mp4", "webm", "webp") else "mp4"
        raise ConfigError(
            f"out={out}: a folder gets the frames, and the films beside them.",
            f"Name the folder, and the format of the films: out={out.with_suffix('')} "
            f"video={video}",
        )


def check_channels(options: RenderOptions) -> None:
    """Refuse channels that are not there, and options that do not suit them.

    Raises:
        ConfigError: names the option, the cause and the remedy.
    """
    from gsfw.rendering.channels import find_channel

    with_photo = [name for name in options.channel if find_channel(name).needs_image]
    if with_photo and (_has_file(options) or options.what != "views"):
        raise ConfigError(
            f"{_written(options, 'channel')}: {with_photo[0]} needs a photo, and there is "
            "none along a camera path.",
            f"Render what=views, or leave {with_photo[0]} out.",
        )
    _check_rules(options, CHANNEL_RULES)


def _check_rules(options: RenderOptions, rules: tuple[Rule, ...]) -> None:
    for rule in rules:
        for name in rule.options:
            if _is_given(options, name) and not rule.holds(options):
                has_path = rule.against == "what" and _has_file(options)
                both = [name, "camera" if has_path else rule.against]
                shown = " ".join(
                    _written(options, item) for item in both if getattr(options, item) != ()
                )
                raise ConfigError(
                    f"{shown}: {rule.cause}.",
                    f"{rule.remedy}, or leave {name} out.",
                )


def _check_numbers(options: RenderOptions) -> None:
    if options.frames is not None and options.frames < 1:
        raise ConfigError(f"frames={options.frames}: expected at least 1 frame.")
    if options.fps is not None and not 1 <= options.fps <= MOST_FPS:
        raise ConfigError(f"fps={options.fps}: expected 1 to {MOST_FPS} frames per second.")
    if options.width and options.scale != 1:
        raise ConfigError(
            f"width={options.width} scale={options.scale:g}: both give the size of the frames.",
            "Leave one of them out.",
        )
    if options.range and (len(options.range) != 2 or not options.range[0] < options.range[1]):
        raise ConfigError(
            f"{_written(options, 'range')}: expected two numbers, the smaller one first.",
            "Write range=LOW,HIGH, such as range=0,5.",
        )
    if options.background:
        parse_background(options.background)


def _shown(options: RenderOptions) -> list[Channel]:
    """The channels that are rendered."""
    from gsfw.rendering.channels import CHANNELS
    from gsfw.rendering.request import VIEW_CHANNELS

    return [CHANNELS[name] for name in options.channel or VIEW_CHANNELS]


def _is_given(options: RenderOptions, name: str) -> bool:
    """True if an option asks for something; video=none asks for no film."""
    default = next(item.default for item in fields(options) if item.name == name)
    value = getattr(options, name)
    return value != default and (name, value) != ("video", "none")


def _written(options: RenderOptions, name: str) -> str:
    """An option as it is written on the command line."""
    value = getattr(options, name)
    if isinstance(value, bool):
        return f"{name}={str(value).lower()}"
    items = value if isinstance(value, tuple) else (value,)
    texts = (f"{item:g}" if isinstance(item, float) else str(item) for item in items)
    return f"{name}={','.join(texts)}"
