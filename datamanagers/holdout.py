"""Hold-out: the frames that are left out of training, for evaluation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

import numpy as np

from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError
from gsfw.core.hold_out import HoldOutBy
from gsfw.core.words import listed, suggestion
from gsfw.datamanagers.frames import Frame, Recording, Sightings
from gsfw.datamanagers.view_spread import lonely_views, places_of, spread_views

WHOLE_CAMERAS = 4
"""Fewest cameras of which one is held out: two or three of them have to show every time."""
WHOLE_PLACES = 4
"""Fewest places of which one is held out with all of its views."""


@dataclass(frozen=True)
class HeldOut:
    """The split of a capture."""

    splits: tuple[Split, ...]
    """The part of each frame."""
    how: str
    """Rule that chose them, as a clause."""
    notes: tuple[str, ...] = ()
    """Sentences on what the rule would have held out, and did not."""


def hold_out(frames: Sequence[Frame], request: DataRequest, recording: Recording) -> HeldOut:
    """The split of each frame, and how it came about.

    Names that the user gave come first, then the data set's own split, then a share of the images,
    chosen by ``DataRequest.eval_by``.

    Args:
        frames: those of the recording, sorted by name.
        request: what the user wants held out.
        recording: says how its own split came about, and which frames show which points.

    Raises:
        DataError: there is no image of a name that was given, or there are no cameras to choose.
    """
    if request.eval_names:
        return _held({_find(name, frames) for name in request.eval_names}, frames, "by name")
    if any(frame.split is not None for frame in frames):
        own = [index for index, frame in enumerate(frames) if frame.split is Split.EVAL]
        return _held(own, frames, recording.split_origin)
    if request.eval_every_nth == 0:
        return _held((), frames, "as asked for")
    return _RULES[request.eval_by](frames, request.eval_every_nth, recording)


def _held(
    held: Collection[int], frames: Sequence[Frame], how: str, notes: tuple[str, ...] = ()
) -> HeldOut:
    splits = [Split.EVAL if index in held else Split.TRAIN for index in range(len(frames))]
    return HeldOut(tuple(splits), how, notes)


def _automatic(frames: Sequence[Frame], every: int, recording: Recording) -> HeldOut:
    """Whole cameras or images of other times where several cameras film; else places by name."""
    if not _films_from_several_places(frames):
        if _is_moving(frames):
            return _by_name(frames, every, recording)
        return _with_neighbors(_by_place(frames, every, recording), frames, recording)
    if recording.whole_cameras and _count_cameras(frames) >= WHOLE_CAMERAS:
        return _by_camera(frames, every, recording)
    return _few_cameras(frames, every)


def _by_name(frames: Sequence[Frame], every: int, recording: Recording) -> HeldOut:
    """Every n-th from the first: the protocol of Mip-NeRF 360 and most papers since."""
    return _held(range(0, len(frames), every), frames, f"every {_ordinal(every)} by name")


def _by_place(frames: Sequence[Frame], every: int, recording: Recording) -> HeldOut:
    """Every n-th place by name, with all of its views; by name where each view has its own place.

    Views of a panorama overlap, so that the others would show most of a single one of them.
    """
    places = places_of(frames)
    count = len(set(places))
    if count == len(frames) or count < WHOLE_PLACES:
        return _by_name(frames, every, recording)
    kept = [index for index, place in enumerate(places) if place % every == 0]
    how = f"every {_ordinal(every)} of {count} places by name, with all views from there"
    return _held(kept, frames, how)


def _by_spread(frames: Sequence[Frame], every: int, recording: Recording) -> HeldOut:
    """As many as by name, from all places and directions."""
    count = -(-len(frames) // every)
    return _held(spread_views(frames, count), frames, f"one of {every}, spread over space")


def _by_camera(frames: Sequence[Frame], every: int, recording: Recording) -> HeldOut:
    """Every n-th camera, and at least one, with all of its images; spread over space.

    Raises:
        DataError: there are no several cameras.
    """
    first = {frame.camera: frame for frame in reversed(frames)}
    if len(first) < 2:
        raise DataError(
            f"holdout_by={HoldOutBy.CAMERA.value}: all {len(frames)} images are those of one "
            "camera.",
            f"Hold out single images: holdout_by={HoldOutBy.NAME.value} or "
            f"{HoldOutBy.SPREAD.value}.",
        )
    cameras = sorted(first)
    chosen = spread_views([first[camera] for camera in cameras], max(1, len(cameras) // every))
    held = {cameras[position] for position in chosen}
    kept = [index for index, frame in enumerate(frames) if frame.camera in held]
    named = ", ".join(first[camera].name for camera in sorted(held))
    return _held(kept, frames, f"{len(held)} of {len(cameras)} whole cameras, that of {named}")


def _few_cameras(frames: Sequence[Frame], every: int) -> HeldOut:
    """Every n-th image by time; none of the first time, and one of a time at most.

    Methods build the scene from the first time, and follow what the others still show.
    """
    order = sorted(range(len(frames)), key=lambda i: (frames[i].time or 0.0, frames[i].name))
    start = frames[order[0]].time
    views = Counter(frame.time for frame in frames)
    held: dict[float | None, int] = {}
    for index in order[every - 1 :: every]:
        time = frames[index].time
        if time != start and views[time] > 1:
            held.setdefault(time, index)
    cameras = _count_cameras(frames)
    how = (
        f"every {_ordinal(every)} by time, one of a time and none of the first, as whole cameras "
        f"would leave {cameras - 1} of {cameras}"
    )
    return _held(set(held.values()), frames, how)


def _with_neighbors(found: HeldOut, frames: Sequence[Frame], recording: Recording) -> HeldOut:
    """Give back to training what no training view shows; at least one view stays held out."""
    held = {index for index, split in enumerate(found.splits) if split is Split.EVAL}
    if len(held) == len(frames):
        return found
    lonely = lonely_views(frames, held, _sightings(frames, recording))
    given_back, kept = lonely[: len(held) - 1], lonely[len(held) - 1 :]
    how, notes = found.how, []
    if given_back:
        how += f", but {len(given_back)} that no other image is near"
        notes.append(
            f"{_named(given_back, frames)} would be held out ({found.how}), but no other image "
            f"shows the same: trained on instead (holdout_by={HoldOutBy.NAME.value} holds out all "
            "the same)"
        )
    if kept:
        notes.append(
            f"{_named(kept, frames)} is held out, and no other image shows the same: its figures "
            "say little"
        )
    return _held(held.difference(given_back), frames, how, tuple(notes))


def _named(views: Sequence[int], frames: Sequence[Frame]) -> str:
    return listed([frames[index].name for index in sorted(views)], 3)


def _sightings(frames: Sequence[Frame], recording: Recording) -> Sightings:
    """Sightings with the rows of the sorted frames; none where they cannot be read."""
    try:
        found = recording.read_sightings()
    except DataError:  # Training needs them for nothing else.
        return Sightings.none()
    row = {frame.name: index for index, frame in enumerate(frames)}
    rows = np.array([row[frame.name] for frame in recording.frames], np.int64)
    return replace(found, frames=rows[found.frames])


def _is_moving(frames: Sequence[Frame]) -> bool:
    return any(frame.time is not None for frame in frames)


def _count_cameras(frames: Sequence[Frame]) -> int:
    return len({frame.camera for frame in frames})


def _films_from_several_places(frames: Sequence[Frame]) -> bool:
    """True if most times have images of several cameras."""
    cameras: dict[float, set[int]] = {}
    for frame in frames:
        if frame.time is not None:
            cameras.setdefault(frame.time, set()).add(frame.camera)
    several = sum(len(found) > 1 for found in cameras.values())
    return len(cameras) > 1 and several > len(cameras) / 2


_RULES: dict[HoldOutBy, Callable[[Sequence[Frame], int, Recording], HeldOut]] = {
    HoldOutBy.AUTO: _automatic,
    HoldOutBy.NAME: _by_name,
    HoldOutBy.SPREAD: _by_spread,
    HoldOutBy.CAMERA: _by_camera,
}


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
    hint = suggestion(name, [frame.name for frame in frames])
    raise DataError(
        f"holdout={name}: no image has this name.{hint}",
        f"The {len(frames)} images are {frames[0].name} to {frames[-1].name}.",
    )


def _ordinal(number: int) -> str:
    suffix = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number // 10 % 10 == 1 else suffix}"
