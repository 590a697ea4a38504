"""Video files: the times of their images, and the images in order.

Decoding begins at key frames only, so images come in segments: from one key frame to the next.
"""

from __future__ import annotations

import statistics
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from gsfw.core.errors import DataError
from gsfw.datamanagers.detection import VIDEOS
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.video_container import ADVICE, opened_video, reason_of, time_stamps
from gsfw.datamanagers.video_traits import VideoTraits, conversion

UNEVEN = 0.5
"""An interval that differs from the median by more than this part of it: an image is missing."""

Box = tuple[int, int, int, int]
"""Left, top, right and bottom edge in pixels; the right and bottom ones are just outside."""


@dataclass(frozen=True)
class Video:
    """A video file; nothing of it is held open."""

    path: Path
    header: Header
    """Header of the images as shown: rotated as the file requires, and cropped to ``box``."""
    stamps: tuple[int, ...]
    """Time of each image, ascending, in units of ``unit``."""
    unit: float
    """Seconds."""
    keys: tuple[int, ...]
    """Numbers of the images that decoding can begin at; the first is 0."""
    traits: VideoTraits
    """Stored form of the images."""
    box: Box | None = None
    """The part of the upright images that is used; ``None`` for all."""

    @staticmethod
    def read(path: Path) -> Video:
        """Go through the packets, and decode the first image only.

        Raises:
            DataError: it is no video, or it is cut off or damaged, as far as packets tell.
            UnavailableError: PyAV is not installed.
        """
        with opened_video(path) as (container, stream):
            stamps, keys = time_stamps(path, container, stream)
            unit = float(stream.time_base)
        order = sorted(stamps)
        numbers = {stamp: number for number, stamp in enumerate(order)}
        video = Video(
            path=path,
            header=Header(0, 0, has_alpha=False),
            stamps=tuple(order),
            unit=unit,
            keys=tuple(sorted({0, *(numbers[stamp] for stamp in keys)})),
            traits=VideoTraits(0, 0),
        )
        with opened_video(path) as (container, stream):
            first = next(video._decoded(container, stream), None)
            if first is None:
                raise DataError(f"{path}: none of its {len(order)} images decodes.", ADVICE)
            traits = VideoTraits.of(stream, first[1])
        return replace(video, header=Header(*traits.shown_size, has_alpha=False), traits=traits)

    def __len__(self) -> int:
        return len(self.stamps)

    @cached_property
    def times(self) -> tuple[float, ...]:
        """Seconds from the first image to each."""
        return tuple((stamp - self.stamps[0]) * self.unit for stamp in self.stamps)

    @property
    def rate(self) -> float:
        """Images per second, over the whole video; 0 for a single image, or a single time."""
        return (len(self) - 1) / self.times[-1] if self.times[-1] > 0 else 0.0

    def check_even(self) -> None:
        """Check that images follow each other at one rate, so that their number tells the time.

        Raises:
            DataError: they do not; says where.
        """
        intervals = np.diff(self.times)
        if len(intervals) == 0:
            return
        usual = statistics.median(intervals)
        if usual <= 0:
            raise DataError(
                f"{self.path}: most of its images have the time of another one.", ADVICE
            )
        worst = int(np.abs(intervals - usual).argmax())
        if abs(intervals[worst] - usual) > UNEVEN * usual:
            raise DataError(
                f"{self.path}: the frame rate varies: image {worst + 1} comes "
                f"{1000 * intervals[worst]:.1f} ms after the one before, where "
                f"{1000 * usual:.1f} ms are usual.",
                "Cameras are matched by image numbers, which needs one constant rate. Write the "
                f"video anew: ffmpeg -i {self.path.name} -vf fps={1 / usual:.5g} NEW.mp4.",
            )

    def cropped(self, box: Box) -> Video:
        """The same video with a part of each image only."""
        left, top, right, bottom = box
        return replace(self, box=box, header=Header(right - left, bottom - top, has_alpha=False))

    def segment(self, number: int) -> range:
        """The numbers of the images that are decoded together with this one."""
        after = bisect_right(self.keys, number)
        return range(self.keys[after - 1], (*self.keys, len(self))[after])

    def images(self, numbers: Sequence[int]) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Decode images, upright, cropped and in sRGB; in order, each with its number.

        Args:
            numbers: ascending; what lies between them is decoded, too, but goes no further.

        Raises:
            DataError: one of them does not decode.
        """
        for number, frame in self._frames(numbers):
            with conversion(self.path, frame):
                pixels = self.traits.colors(frame)
            yield number, self._upright(pixels, self.box)

    def greys(
        self, numbers: Sequence[int], longest: int
    ) -> Iterator[tuple[int, UInt8[np.ndarray, "h w"]]]:
        """Decode images as ``images`` does, but grey and small, which takes less time.

        Args:
            numbers: ascending.
            longest: the longer side that they get, in pixels; none is enlarged.

        Raises:
            DataError: one of them does not decode.
        """
        scale = min(1.0, longest / max(self.header.width, self.header.height))
        box = None
        if self.box is not None:
            left, top, right, bottom = (round(edge * scale) for edge in self.box)
            box = left, top, right, bottom
        for number, frame in self._frames(numbers):
            width, height = (max(1, round(side * scale)) for side in (frame.width, frame.height))
            with conversion(self.path, frame):
                small = frame.reformat(width, height, "gray", interpolation="AREA").to_ndarray()
            yield number, self._upright(small, box)

    def image(self, number: int) -> UInt8[np.ndarray, "h w 3"]:
        """Decode one image, and those between the key frame before and it.

        Raises:
            DataError: it does not decode.
        """
        return next(self.images([number]))[1]

    def _frames(self, numbers: Sequence[int]) -> Iterator[tuple[int, Any]]:
        """Images as FFmpeg has them, in order, each with its number.

        Raises:
            DataError: one of them, or of those between, does not decode.
        """
        if not numbers:
            return
        expected, last, wanted = numbers[0], numbers[-1], frozenset(numbers)
        start = self.segment(expected).start
        with opened_video(self.path) as (container, stream):
            if start > 0:
                container.seek(self.stamps[start], stream=stream)
            for number, frame in self._decoded(container, stream):
                if number < expected:
                    continue
                if number > expected:
                    break
                self.traits.check_size(self.path, number, frame)
                if number in wanted:
                    yield number, frame
                if number == last:
                    return
                expected += 1
        raise DataError(f"{self.path}: image {expected} of {len(self)} does not decode.", ADVICE)

    def _decoded(self, container: Any, stream: Any) -> Iterator[tuple[int, Any]]:  # noqa: ANN401
        """Images from wherever the container stands, as FFmpeg has them, with their numbers."""
        import av

        numbers = {stamp: number for number, stamp in enumerate(self.stamps)}
        latest = -1
        try:
            for frame in container.decode(stream):
                number = numbers.get(frame.pts)
                if number is None:
                    continue
                if frame.is_corrupt:
                    raise DataError(
                        f"{self.path}: image {number} of {len(self)} "
                        f"(at {self.times[number]:.3f} s) is damaged.",
                        ADVICE,
                    )
                latest = number
                yield number, frame
        except (av.FFmpegError, OSError) as error:
            after = f"after image {latest}" if latest >= 0 else "its first image"
            raise DataError(
                f"{self.path}: {after} of {len(self)}, the video does not decode: "
                f"{reason_of(error)}",
                ADVICE,
            ) from error

    def _upright(
        self, pixels: UInt8[np.ndarray, "h w *d"], box: Box | None
    ) -> UInt8[np.ndarray, "h2 w2 *d"]:
        upright = self.traits.upright(pixels)
        if box is not None:
            left, top, right, bottom = box
            upright = upright[top:bottom, left:right]
        return np.ascontiguousarray(upright)


@dataclass(frozen=True)
class Shot:
    """One image of a video, as ``Frame.shot``."""

    video: Video
    """The video, from ``Video.read``."""
    number: int
    """Counted from 0."""

    def as_stored(self) -> Shot:
        """The same image, whose numbers are taken for sRGB."""
        traits = replace(self.video.traits, transfer=0, primaries=0)
        return replace(self, video=replace(self.video, traits=traits))


def is_video(path: Path) -> bool:
    """True if a file's name says that it is a video."""
    return path.suffix.lower() in VIDEOS and path.is_file()
