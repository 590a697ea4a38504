"""Notes on the content that a layout cannot hold, so that nothing is lost without a word."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gsfw.core.datamanager import Split
from gsfw.core.files.atomic import write_atomically
from gsfw.datamanagers.frames import Recording
from gsfw.datamanagers.map_file import DEPTH
from gsfw.preparation.writing.written_files import COLMAP, MODEL_FOLDER, TRANSFORMS

SPLIT_LIST = f"{MODEL_FOLDER}/test.txt"
"""Names of held-out images, one a line, as the code of Kerbl et al. 2023 reads them."""
LISTED = 5
"""Held-out images that are spelled out; more are left to a command that reads the list."""
UP = {COLMAP: "-y", TRANSFORMS: "z"}
"""The direction that readers of the layouts take to be up."""


def write_split_list(written: Recording, out: Path) -> int:
    """Write the names of the frames that the data set itself holds out, relative to images/.

    Returns:
        Bytes written; 0 where it holds out none.

    Raises:
        OutputError: the list cannot be written.
    """
    content = "".join(f"{name}\n" for name in _held(written)).encode()
    if content:
        write_atomically(out / SPLIT_LIST, content)
    return len(content)


def conversion_notes(
    recording: Recording, written: Recording, layout: str, out: Path
) -> tuple[str, ...]:
    """Notes on a conversion for the user.

    Args:
        recording: what was converted.
        written: what was written, in any order.
        layout: colmap or transforms.
        out: the written data set.
    """
    own = _of_colmap(recording, written, out) if layout == COLMAP else _of_transforms(recording)
    return (*_of_both(recording, layout), *own)


def _of_both(recording: Recording, layout: str) -> Iterator[str]:
    shots = [frame for frame in recording.frames if frame.shot is not None]
    if shots:
        videos = len({frame.path for frame in shots})
        yield f"{len(shots)} images of {videos} videos are JPEG files now"
    maps = sorted({name for frame in recording.frames for name in frame.maps} - {DEPTH})
    if maps:
        yield f"per-view maps are not written: {', '.join(maps)}"
    if recording.point_times is not None:
        yield "points have no times any more: all of them are there from the beginning"
    if recording.up and recording.up != UP[layout]:
        yield (
            f"the world stays as it was, with {recording.up} upwards; readers of this layout take "
            f"{UP[layout]} to be up"
        )


def _of_colmap(recording: Recording, written: Recording, out: Path) -> Iterator[str]:
    lost = {
        "times": sum(frame.time is not None for frame in recording.frames),
        "masks of what moves": sum(frame.moving is not None for frame in recording.frames),
        "depths": sum(DEPTH in frame.maps for frame in recording.frames),
    }
    for what, count in lost.items():
        if count:
            yield (
                f"a COLMAP model cannot hold {what}, which {count} images have: use "
                "layout=transforms to keep them"
            )
    if len(recording.points):
        yield "points have no tracks (which images saw them): gsfw needs none, other programs may"
    held = _held(written)
    if held:
        names = ",".join(held)
        if len(held) > LISTED:
            names = f'"$(paste -sd, {out / SPLIT_LIST})"'
        yield (
            f"a COLMAP model cannot say what is held out ({len(held)} of {len(written.frames)} "
            f"images, listed in {SPLIT_LIST}): train with holdout={names}, or use "
            "layout=transforms"
        )


def _of_transforms(recording: Recording) -> Iterator[str]:
    times = [frame.time for frame in recording.frames if frame.time is not None]
    others = [*times, *recording.unused_times]
    if times and (min(times), max(times)) != (min(others), max(others)):
        yield (
            f"times go from {min(times):g} to {max(times):g} now, as images from "
            f"{min(others):g} to {max(others):g} that were neither trained nor evaluated on are "
            "left out"
        )


def _held(written: Recording) -> list[str]:
    """Names relative to images/ of what the data set itself holds out."""
    return [frame.name.partition("/")[2] for frame in written.frames if frame.split is Split.EVAL]
