"""Which frames are held out of training, to measure with."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import PurePosixPath

from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import Frame


def hold_out(
    frames: Sequence[Frame], request: DataRequest, own: str = "the data set's own split"
) -> tuple[list[Split], str]:
    """The split of each frame, and how it came about.

    Names that the user gave come first, then the data set's own split, then every n-th.

    Args:
        frames: sorted by name.
        request: what the user wants held out.
        own: how the data set's own split came about.

    Raises:
        DataError: there is no image of a name that was given.
    """
    if request.eval_names:
        held = {_find(name, frames) for name in request.eval_names}
        how = "by name"
    elif any(frame.split is not None for frame in frames):
        held = {index for index, frame in enumerate(frames) if frame.split is Split.EVAL}
        how = own
    elif request.eval_every_nth > 0:
        held = set(range(0, len(frames), request.eval_every_nth))
        how = f"every {_ordinal(request.eval_every_nth)} by name"
    else:
        held, how = set(), "as asked for"
    splits = [Split.EVAL if index in held else Split.TRAIN for index in range(len(frames))]
    return splits, how


def _find(name: str, frames: Sequence[Frame]) -> int:
    """The frame of this name, or of this file name where that is enough to tell it."""
    exact = [index for index, frame in enumerate(frames) if frame.name == name]
    if exact:
        return exact[0]
    ends = [i for i, frame in enumerate(frames) if PurePosixPath(frame.name).name == name]
    if len(ends) == 1:
        return ends[0]
    if ends:
        raise DataError(
            f"holdout={name}: {len(ends)} images have this file name, "
            f"{frames[ends[0]].name} and {frames[ends[1]].name} among them.",
            "Give the name with its folder.",
        )
    near = difflib.get_close_matches(name, [frame.name for frame in frames], 1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise DataError(
        f"holdout={name}: no image has this name.{hint}",
        f"The {len(frames)} images are {frames[0].name} to {frames[-1].name}.",
    )


def _ordinal(number: int) -> str:
    suffix = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number // 10 % 10 == 1 else suffix}"
