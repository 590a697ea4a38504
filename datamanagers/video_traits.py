"""Video traits: properties of a video's images that differ from plain ones, by its first image."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt, UInt8

from gsfw.core.errors import DataError
from gsfw.datamanagers.coded_colors import coded_to_srgb, is_like_srgb

BT709, UNSPECIFIED, BT601 = 1, 2, 5
"""Matrices (ITU-T H.273, table 4)."""


@dataclass(frozen=True)
class VideoTraits:
    """Stored form of a video's images."""

    width: int
    """Pixels of an image as it is stored."""
    height: int
    """Rows of an image as it is stored."""
    mirrored: bool = False
    """True if an image is to be mirrored, left to right, before it is turned."""
    turns: int = 0
    """Quarter turns, counter-clockwise, that make an image upright."""
    tilt: int = 0
    """Degrees, of at most 45, that an image is still to be turned after that, and is not."""
    aspect: Fraction = Fraction(1)
    """Width of a stored pixel divided by its height."""
    transfer: int = 0
    """Transfer characteristic, by its number in ITU-T H.273."""
    primaries: int = 0
    """Primaries, by their number in ITU-T H.273."""
    interlaced: bool = False
    """True if the rows of an image are of two times, in turn."""
    projection: int | None = None
    """Projection of a 360-degree video, by its number in FFmpeg (AVSphericalProjection), as the
    file states it (boxes sv3d, or XMP data); ``None`` for other videos."""
    stereo: bool = False
    """True if an image shows two views side by side, or one above the other."""

    @staticmethod
    def of(stream: Any, frame: Any) -> VideoTraits:  # noqa: ANN401
        """The traits of a stream and its first image, which PyAV gives."""
        mirrored, turns = _display(frame)
        ratio = stream.sample_aspect_ratio  # A number of its own from PyAV 19 on; 0: not stated.
        tilt = abs(frame.rotation - 90 * round(frame.rotation / 90))
        return VideoTraits(
            width=frame.width,
            height=frame.height,
            mirrored=mirrored,
            turns=turns,
            tilt=tilt if tilt > 1 else 0,  # PyAV cuts off parts of a degree.
            aspect=Fraction(ratio.numerator, ratio.denominator) if ratio else Fraction(1),
            transfer=stream.codec_context.color_trc,
            primaries=stream.codec_context.color_primaries,
            interlaced=frame.interlaced_frame,
            projection=_first_number(frame, "SPHERICAL"),
            stereo=bool(_first_number(frame, "STEREO3D")),
        )

    @property
    def shown_size(self) -> tuple[int, int]:
        """Width and height of the upright image, in pixels."""
        return (self.height, self.width) if self.turns % 2 else (self.width, self.height)

    def colors(self, frame: Any) -> UInt8[np.ndarray, "h w 3"]:  # noqa: ANN401
        """Pixels of an image that PyAV gives, in sRGB."""
        if is_like_srgb(self.transfer, self.primaries):
            return _red_green_blue(frame, "rgb24")
        pixels = _red_green_blue(frame, "rgb48le")
        return coded_to_srgb(pixels, self.transfer, self.primaries)

    def upright(self, pixels: UInt8[np.ndarray, "h w *d"]) -> UInt8[np.ndarray, "h2 w2 *d"]:
        """A stored image as it is to be shown."""
        return np.rot90(pixels[:, ::-1] if self.mirrored else pixels, self.turns)

    def check_size(self, path: Path, number: int, frame: Any) -> None:  # noqa: ANN401
        """Check that a later image has the size of the first: recordings of calls change theirs.

        Raises:
            DataError: it has another one.
        """
        if (frame.width, frame.height) != (self.width, self.height):
            raise DataError(
                f"{path}: image {number} has {frame.width}x{frame.height} pixels, and the first "
                f"one {self.width}x{self.height}.",
                "Write the video anew, with images of one size: ffmpeg -i OLD NEW.mp4.",
            )

    def notes(self) -> Iterator[str]:
        """Clauses on images that do not look as they should."""
        if self.tilt:
            yield (
                f"the video says that its images are tilted by {self.tilt} degrees, and gsfw "
                "only applies quarter turns; cameras that are computed from them are tilted, too, "
                "which does no harm; ffmpeg -i OLD NEW.mp4 writes a video without the tilt"
            )
        if self.interlaced:
            yield (
                "the video is interlaced: the rows of an image show two times, so moving edges are "
                "jagged; write it anew with ffmpeg -i OLD -vf bwdif=send_frame NEW.mp4"
            )


@contextmanager
def conversion(path: Path, frame: Any) -> Iterator[None]:  # noqa: ANN401
    """Check that FFmpeg converts the colours of a frame, which PyAV gives.

    Raises:
        DataError: it does not, such as those of BT.2020 with constant luminance.
    """
    try:
        yield
    except OSError as error:
        raise DataError(
            f"{path}: FFmpeg does not convert its colours (matrix {int(frame.colorspace)} of "
            f"ITU-T H.273): {error.strerror}.",
            "Export the video as Rec. 709 from a video editor.",
        ) from error


def _red_green_blue(frame: Any, layout: str) -> UInt[np.ndarray, "h w 3"]:  # noqa: ANN401
    """The pixels of an image in a layout of FFmpeg, by the matrix and range that the file states.

    PyAV before 17 applies them only where those of the result, which mean nothing for RGB, differ.
    """
    if frame.colorspace == UNSPECIFIED:
        return np.asarray(frame.to_ndarray(format=layout))
    converted = frame.reformat(
        format=layout,
        src_colorspace=frame.colorspace,
        dst_colorspace=BT601 if frame.colorspace != BT601 else BT709,
        src_color_range=frame.color_range or None,
    )
    return np.asarray(converted.to_ndarray())


def _first_number(frame: Any, name: str) -> int | None:  # noqa: ANN401
    """The number that side data of FFmpeg begin with: their type; ``None`` where there are none."""
    data = frame.side_data.get(name)
    return None if data is None else int(struct.unpack("=i", bytes(data)[:4])[0])


def _display(frame: Any) -> tuple[bool, int]:  # noqa: ANN401
    """Mirroring and quarter turns that make an image upright."""
    # FFmpeg gives the counter-clockwise angle by which the image is to be turned.
    turns = round(frame.rotation / 90) % 4
    matrix = frame.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return False, turns
    a, b, _, c, d = struct.unpack("=5i", bytes(matrix)[:20])
    # FFmpeg's angle is that of the first row, which a mirror image has the other way round.
    return (True, (turns + 2) % 4) if a * d < b * c else (False, turns)
