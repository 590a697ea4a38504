"""Frames: sharp, well-spaced images of videos, as files that the other stages work on."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

from gsfw.datamanagers.frames import name_key
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.video import Video
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import SourceImage
from gsfw.preparation.input_files import writable
from gsfw.preparation.journal import Journal, identity_of
from gsfw.preparation.panorama import kind_of_video
from gsfw.preparation.workspace import Workspace

FEWEST = 3
"""Frames of a video, however short it is beside the others."""


def frames_of_videos(
    paths: Sequence[Path],
    count: int,
    photos: Sequence[SourceImage],
    place: Workspace,
    journal: Journal,
    say: Callable[[str], None],
) -> tuple[SourceImage, ...]:
    """Take frames from videos, in proportion to their durations.

    Args:
        paths: of the videos.
        count: how many frames from all of them together.
        photos: images beside the videos, whose names and cameras are others.
        place: where they are put.
        journal: knows which videos are done.
        say: shows a line of text.

    Raises:
        DataError: a video is damaged.
        UnavailableError: PyAV is not installed.
        OutputError: frames cannot be written.
    """
    videos = [Video.read(path) for path in paths]
    seconds = [max(video.times[-1], 1e-3) for video in videos]
    names = _names(paths, {photo.name.split("/")[0] for photo in photos})
    taken: list[SourceImage] = []
    for name, video, length in zip(names, videos, seconds, strict=True):
        share = max(FEWEST, round(count * length / sum(seconds)))
        taken += _frames_of(video, name, share, place, journal, say)
    if len(videos) > 1 or photos:
        return tuple(taken)
    return tuple(replace(one, name=one.path.name, group="") for one in taken)


def _names(paths: Sequence[Path], others: Collection[str]) -> list[str]:
    """A folder for each video, named after it; numbered where some disk has such a name already."""
    taken = {name_key(name) for name in others}
    names: list[str] = []
    for path in paths:
        stem = writable(path.stem).strip(". ") or "video"
        name, number = stem, 1
        while name_key(name) in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name_key(name))
        names.append(name)
    return names


def _frames_of(
    video: Video,
    name: str,
    count: int,
    place: Workspace,
    journal: Journal,
    say: Callable[[str], None],
) -> list[SourceImage]:
    from gsfw.preparation.video_frames import FrameChoice, choose_frames, write_frames

    folder = place.frames / name
    chosen = journal.stage(
        f"choice of frames of {name}",
        {"video": identity_of(video.path), "count": count},
        lambda: choose_frames(video, count).document(),
        lambda: place.remove(folder),
    )
    choice = FrameChoice.of(chosen)
    for note in choice.notes:
        say(f"note: {video.path.name}: {note}")
    # Those that are there are kept, so this is quick where nothing is missing.
    files = write_frames(video, choice, folder)
    said = kind_of_video(video.traits)
    return [
        SourceImage(f"{name}/{file.name}", file, read_header(file), Exif(), name, time, said)
        for file, time in zip(files, choice.seconds, strict=True)
    ]
