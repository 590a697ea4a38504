"""`gsfw make-room`: writes a small RGB-D sequence of a ray-cast room, to try the example with."""

from __future__ import annotations

from dataclasses import dataclass
from shlex import quote

from gsfw.api import ConfigError, Options, read_options


@dataclass(kw_only=True)
class RoomOptions(Options):
    """Write an RGB-D sequence of a synthetic room in the TUM format."""

    examples = ("gsfw make-room out=room", "gsfw make-room out=room frames=40 width=320")

    out: str = ""
    """Folder of the sequence; it must not exist."""
    frames: int = 24
    """Number of images."""
    width: int = 160
    """Width of an image; its height is three quarters."""
    noise: float = 0.005
    """Standard deviation of the depth, in parts of the depth."""


def run(arguments: list[str]) -> int:
    options = read_options("make-room", RoomOptions, arguments)
    from pathlib import Path

    from gsfw.api import Console
    from gsfw_rgbd.room import write_room

    out = Path(options.out)
    if not options.out or out.exists():
        raise ConfigError(f"out={options.out}: expected the name of a new folder.")
    write_room(out, options.frames, options.width, options.noise)
    console = Console(options.json)
    console.say(f"{options.frames} images with depth in {out}; gsfw train data={quote(str(out))}")
    console.result({"folder": str(out), "frames": options.frames})
    return 0
