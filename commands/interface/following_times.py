"""Times of the images for a training that follows a preparation, if its method needs them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gsfw.core.errors import ConfigError

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console

Layout = Literal["auto", "colmap", "transforms"]

ONLY_VIDEOS = (
    "Give the videos alone: their frames keep their times. Or leave method out after train=true: "
    "method=3dgs trains on photos of a scene that stands still."
)


def layout_with_times(
    method: str, layout: Layout, inputs: Sequence[Path] | None, console: Console
) -> Layout:
    """The layout that keeps times; refuses images without times before cameras are computed.

    Args:
        method: the method to train afterwards, which trains on images with times alone.
        layout: the layout that was asked for.
        inputs: folders, photos and videos; ``None`` for a data set that has cameras, whose times
            are checked when it is read.
        console: to say which layout is chosen.

    Raises:
        ConfigError: the layout has no times, or there are photos; names the first.
        DataError: an input cannot be read.
    """
    if layout == "colmap":
        raise ConfigError(
            f"layout=colmap: a COLMAP model has no times, and method {method} trains on images "
            "with times.",
            "Leave layout out: layout=transforms keeps the times of frames.",
        )
    if inputs is None:
        return layout
    photos = _photos(inputs)
    if photos:
        raise ConfigError(
            f"method {method} trains on images with times, and photos such as {photos[0]} have "
            "none.",
            ONLY_VIDEOS,
        )
    if layout != "transforms":
        console.say(f"layout=transforms: it keeps the times of frames, which method {method} needs")
    return "transforms"


def _photos(inputs: Sequence[Path]) -> list[Path]:
    from gsfw.datamanagers.detection import PHOTOS
    from gsfw.preparation.input_files import InputFiles

    found = (file.path for file in InputFiles.find(inputs).files)
    return [path for path in found if path.suffix.lower() in PHOTOS]
