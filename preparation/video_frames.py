"""FrameChoice: sharp frames of a video at equal changes of the view, and their files."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image

from gsfw.core.errors import ConfigError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.progress import stage
from gsfw.core.words import listed
from gsfw.datamanagers.video import Video
from gsfw.preparation.frame_spacing import NEAREST, spaced
from gsfw.preparation.image_quality import BLURRED
from gsfw.preparation.view_change import NO_OVERLAP, SIDE, ViewPath

LOOKED_AT = 20
"""Frames that are looked at for each that is asked for, at most ..."""
OFTEN = 5.0
"""... where that makes no fewer than these a second: two of a quick pan still overlap then."""
SHARPNESS_SIDE = 960
"""The longer side of the grey images that sharpness is measured on, in pixels."""
STRIP = 48
"""Rows that are worked on at once: they stay in the processor's cache, which takes 0.7 ms for a
frame instead of 3.7."""
AROUND = 1.0
"""Seconds before and after a frame within which others tell how sharp it could be."""
BRIDGED = 0.1
"""Change of the view, of the longer side, that needs no blurred frame between two sharp ones."""
HARDLY = 0.05
"""Change of the view, of the longer side, below which a camera hardly moves."""
FEWER = 0.9
"""Part of the frames asked for that is as good as all of them."""
RESTLESS = 0.1
"""Part of the frames looked at that may be jumps of the view; more are no cuts."""
ROUNDED = 0.01
"""Deviation of pixels from squares that some cameras note for a size that they have rounded."""
JPEG_QUALITY = 97
"""JPEG quality of frames; with colours at full resolution. Features are found at the same places
from about 95 on, and the file takes half the room of a PNG."""


@dataclass(frozen=True)
class FrameChoice:
    """The frames of a video to use."""

    numbers: tuple[int, ...]
    """Counted from 0, ascending; at least one."""
    seconds: tuple[float, ...]
    """From the first frame of the video to each."""
    sharpness: tuple[float, ...]
    """Relative sharpness of each, in [0, 1]: 1 for the sharpest frame within a second."""
    looked_at: int
    """Frames that were measured."""
    notes: tuple[str, ...] = ()
    """Notes on the video for the user; each a clause."""

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @staticmethod
    def of(document: Mapping[str, Any]) -> FrameChoice:
        """The choice that ``document`` told of."""
        return FrameChoice(
            numbers=tuple(document["numbers"]),
            seconds=tuple(document["seconds"]),
            sharpness=tuple(document["sharpness"]),
            looked_at=document["looked_at"],
            notes=tuple(document["notes"]),
        )


def choose_frames(video: Video, count: int) -> FrameChoice:
    """Choose about ``count`` sharp frames, at equal changes of the view.

    All frames are decoded once, and at most ``LOOKED_AT`` for each one asked for are looked at.

    Raises:
        ConfigError: ``count`` is below 1.
        DataError: the video does not decode.
    """
    if count < 1:
        raise ConfigError(f"frames={count}: expected at least 1.", "The usual number is 150.")
    numbers = _looked_at(video, count)
    path, sharpness = ViewPath(), []
    with stage("choosing frames", len(numbers)) as advance:
        for number, grey in video.greys(numbers, SHARPNESS_SIDE):
            small = _small(grey)
            sharpness.append(_sharpness(grey, small))
            path.add(small)
            advance(numbers.index(number) + 1)
    times = np.array([video.times[number] for number in numbers])
    relative = _relative(np.array(sharpness), times, path)
    positions, usable = np.array(path.positions), _usable(path, relative)
    chosen = spaced(positions, times, np.array(sharpness), usable, count)
    relative = relative[chosen]
    return FrameChoice(
        numbers=tuple(numbers[index] for index in chosen),
        seconds=tuple(float(times[index]) for index in chosen),
        sharpness=tuple(round(float(value), 3) for value in relative),
        looked_at=len(numbers),
        notes=tuple(
            [
                *_notes_on_pixels(video),
                *_notes_on_number(len(chosen), count, video, path),
                *_notes_on_view(path, times),
                *_notes_on_blur(relative),
            ]
        ),
    )


def write_frames(video: Video, choice: FrameChoice, folder: Path) -> tuple[Path, ...]:
    """Write the chosen frames as JPEG, each whole or not at all; their files, in order.

    Those that are there already are kept, and others in the folder are left alone. What lies
    between two key frames is decoded only where one of its frames is missing.

    Raises:
        OutputError: one cannot be written.
        DataError: one does not decode.
    """
    files = {number: folder / f"{number:06d}.jpg" for number in choice.numbers}
    missing = [number for number, file in files.items() if not file.is_file()]
    done = len(files) - len(missing)
    with stage("writing frames", len(files)) as advance:
        advance(done)
        for _, group in groupby(missing, key=lambda number: video.segment(number).start):
            for number, pixels in video.images(list(group)):
                write_atomically(files[number], _jpeg(pixels))
                done += 1
                advance(done)
    return tuple(files.values())


def _jpeg(pixels: UInt8[np.ndarray, "h w 3"]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return buffer.getvalue()


def _looked_at(video: Video, count: int) -> range:
    """Every so many frames; an odd number, as some videos hold each image twice."""
    step = max(1, min(len(video) // (LOOKED_AT * count), int(video.rate / OFTEN)))
    return range(0, len(video), step - 1 + step % 2)


def _small(grey: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "h2 w2"]:
    """Shrink an image to the size at which the view is followed; levels in [0, 255]."""
    height, width = grey.shape
    scale = min(1.0, SIDE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(Image.fromarray(grey).resize(size, Image.Resampling.BOX), np.float32)


def _sharpness(grey: UInt8[np.ndarray, "h w"], small: Float[np.ndarray, "h2 w2"]) -> float:
    """Variance of the Laplacian, in units of the small image's: exposure changes both alike.

    Of inner pixels, where its mean is nearly 0, and of whole numbers: on every frame of a video,
    ``ImageQuality`` would take longer than decoding does.
    """
    (height, width), contrast = grey.shape, float(small.var())
    if min(height, width) < 3 or contrast == 0:
        return 0.0
    total = 0.0
    for top in range(0, height - 2, STRIP):
        values = grey[top : top + STRIP + 2].astype(np.int16)
        beside = values[1:-1, :-2] + values[1:-1, 2:] + values[:-2, 1:-1] + values[2:, 1:-1]
        laplacian = (beside - 4 * values[1:-1, 1:-1]).astype(np.float32).ravel()
        total += float(laplacian @ laplacian)
    return total / ((height - 2) * (width - 2)) / contrast


def _relative(
    sharpness: Float[np.ndarray, " n"], times: Float[np.ndarray, " n"], path: ViewPath
) -> Float[np.ndarray, " n"]:
    """Sharpness, in parts of the highest around; what lies beyond a jump is not around."""
    shot = np.zeros(len(times), int)
    shot[path.jumps] = 1
    shot = shot.cumsum()
    counted = np.where(path.strange, 0.0, sharpness)
    relative = np.ones(len(times))
    for index, time in enumerate(times):
        first, last = np.searchsorted(times, [time - AROUND, time + AROUND])
        around = counted[first : last + 1][shot[first : last + 1] == shot[index]]
        if around.max() > 0:
            relative[index] = min(1.0, sharpness[index] / around.max())
    return relative


def _usable(path: ViewPath, relative: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Frames that may be chosen: neither strange, nor blurred where sharp ones are near.

    All of them where all are strange: something has to be chosen.
    """
    positions, strange = np.array(path.positions), np.array(path.strange)
    if strange.all():
        return strange
    sharp = positions[~strange & (relative >= BLURRED)]
    after = np.searchsorted(sharp, positions)
    lower, upper = sharp[(after - 1).clip(min=0)], sharp[after.clip(max=len(sharp) - 1)]
    bridged = np.maximum(upper, positions) - np.minimum(lower, positions) <= BRIDGED
    return np.asarray(~strange & ((relative >= BLURRED) | ~bridged))


def _notes_on_pixels(video: Video) -> Iterator[str]:
    """Notes on tilted, interlaced and oblong images."""
    yield from video.traits.notes()
    if abs(video.traits.aspect - 1) > ROUNDED:
        yield (
            f"its pixels are not square ({video.traits.aspect} as wide as high), and cameras are "
            "computed for square ones; write it anew with ffmpeg -i OLD -vf "
            "scale=iw*sar:ih,setsar=1 NEW.mp4"
        )


def _notes_on_number(chosen: int, count: int, video: Video, path: ViewPath) -> list[str]:
    """Notes on why there are fewer frames than asked for."""
    moved = path.positions[-1] - NO_OVERLAP * len(path.jumps)
    frames = f"{chosen} frame{'s' * (chosen != 1)} chosen where {count} were asked for"
    if all(path.strange):
        return [f"the video shows nothing that could be followed: {frames}"]
    if moved < HARDLY and not path.jumps and len(video) > 1:
        return [
            f"the camera hardly moves ({frames}): the view shifts by {moved:.2%} of an image's "
            f"longer side in {video.times[-1]:.1f} s, and cameras are found only where they move "
            "around what they show; several cameras that stand still need a calibration"
        ]
    if chosen >= FEWER * count:
        return []
    if len(video) < count:
        return [f"{frames}: the video has {len(video)}"]
    return [
        f"{frames}: with more of them, the view would change by less than {NEAREST:.1%} of an "
        "image's longer side from one to the next, or they would be blurred"
    ]


def _notes_on_view(path: ViewPath, times: Float[np.ndarray, " n"]) -> list[str]:
    """Notes on cuts, and on frames that were left out."""
    notes = []
    if len(path.jumps) > RESTLESS * len(times):
        notes.append(
            f"at {len(path.jumps)} of {len(times)} frames the view has nothing in common with the "
            "one before: the camera moves too quickly to follow, or this is no film of one place"
        )
    elif path.jumps:
        seconds = tuple(f"{times[index]:.1f} s" for index in path.jumps)
        notes.append(
            f"cut or very quick turn at {listed(seconds)}: the views before and after have nothing "
            "in common, and cameras may not be found across it"
        )
    if any(path.strange) and not all(path.strange):
        notes.append(
            f"{sum(path.strange)} of {len(times)} frames are left out: they show nothing, or "
            "something else than those before and after"
        )
    return notes


def _notes_on_blur(relative: Float[np.ndarray, " chosen"]) -> list[str]:
    blurred = int((relative < BLURRED).sum())
    if not blurred:
        return []
    verb, them = ("are", "them") if blurred > 1 else ("is", "it")
    return [
        f"{blurred} of {len(relative)} chosen frames {verb} blurred (less than {100 * BLURRED:.0f} "
        f"% of the sharpness of neighbouring frames), and without {them} the view would jump: move "
        "the camera slower there"
    ]
