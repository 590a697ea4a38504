"""Film: a sequence of images on disk as one video."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from gsfw.core.errors import UnavailableError
from gsfw.core.files.atomic import readable_write_errors, write_atomically

if TYPE_CHECKING:
    from av import VideoFrame
    from PIL.Image import Image as Picture

VideoFormat = Literal["auto", "mp4", "webm", "webp", "none"]


@dataclass(frozen=True)
class _Codec:
    """An encoder of PyAV."""

    name: str
    options: Mapping[str, str]


CODECS: Mapping[str, _Codec] = {
    # Constant rate factors at which the loss is hard to see.
    "mp4": _Codec("libx264", {"crf": "18"}),
    "webm": _Codec("libvpx-vp9", {"crf": "24", "b": "0", "row-mt": "1", "cpu-used": "3"}),
}
"""The encoder of each format that needs PyAV: H.264 plays everywhere, VP9 is free of patents."""

COLORS = {"colorspace": 1, "color_primaries": 1, "color_trc": 13, "color_range": 1}
"""Matrix and primaries of BT.709, the curve of sRGB, limited range (ITU-T H.273)."""

INSTALLATION = "pip install 'gsfw[video]'"
"""Command that installs the encoders."""

WEBP_KEY_FRAMES = (9, 60)
"""Least and largest distance of two frames that stand alone; the others hold what changes."""


def choose_format(asked: VideoFormat) -> VideoFormat:
    """The format for ``auto``: mp4 where its encoder is installed, else WebP.

    Raises:
        UnavailableError: mp4 or webm was asked for, and there is no encoder.
    """
    if asked in ("webp", "none"):
        return asked
    wanted: VideoFormat = "webm" if asked == "webm" else "mp4"
    codec = CODECS[wanted].name
    try:
        import av

        if codec in av.codecs_available:
            return wanted
        reason = f"the installed PyAV {av.__version__} has no {codec}"
    except ImportError:
        reason = "PyAV is not installed"
    if asked == "auto":
        return "webp"
    raise UnavailableError(
        f"video={asked} needs an encoder, and {reason}.",
        f"Install it with: {INSTALLATION} (or: pip install av). video=webp needs nothing more.",
    )


def write_film(
    stem: Path, frames: Sequence[Path], fps: int | float, chosen: VideoFormat
) -> list[Path]:
    """Write the frames as one video; the files, no file for the format ``none``.

    Args:
        stem: its path without extension.
        frames: PNG or JPEG files of one size, in order.
        fps: frames per second.
        chosen: as ``choose_format`` returns it.

    Raises:
        OutputError: it cannot be written.
    """
    if chosen == "none":
        return []
    path = stem.with_name(f"{stem.name}.{chosen}")
    if chosen == "webp":
        _write_webp(path, frames, fps)
    else:
        _write_encoded(path, frames, fps, chosen)
    return [path]


def _write_webp(path: Path, frames: Sequence[Path], fps: int | float) -> None:
    """An animated WebP, which browsers show; one frame after another is in memory."""
    buffer = io.BytesIO()
    _frames_as_image(frames).save(
        buffer,
        "WEBP",
        save_all=True,
        duration=round(1000 / fps),
        loop=0,
        kmin=WEBP_KEY_FRAMES[0],
        kmax=WEBP_KEY_FRAMES[1],
    )
    write_atomically(path, buffer.getvalue())


def _write_encoded(
    path: Path, frames: Sequence[Path], fps: int | float, chosen: VideoFormat
) -> None:
    """An mp4 or WebM; an odd last row or column is left out, as their colour format demands."""
    import av

    codec = CODECS[chosen]
    rate = Fraction(fps).limit_denominator(1001)
    with _partial(path) as partial, av.open(str(partial), "w", format=chosen) as container:
        stream = container.add_stream(codec.name, rate=rate, options=dict(codec.options))
        stream.pix_fmt = "yuv420p"
        _state_colors(stream.codec_context)
        for number, frame in enumerate(frames):
            image = _picture(frame)
            width, height = (max(side // 2 * 2, 2) for side in image.size)
            if number == 0:
                stream.width, stream.height = width, height
            even = av.VideoFrame.from_image(image.crop((0, 0, width, height)))
            container.mux(stream.encode(_coded(even)))
        container.mux(stream.encode())


def _coded(frame: VideoFrame) -> VideoFrame:
    """A frame of sRGB by the matrix of HD video, which players also use where a file is silent."""
    matrix, limited = COLORS["colorspace"], COLORS["color_range"]
    coded = frame.reformat(format="yuv420p", dst_colorspace=matrix, dst_color_range=limited)
    _state_colors(coded)
    return coded


def _state_colors(coded: Any) -> None:  # noqa: ANN401
    for name, value in COLORS.items():
        if hasattr(coded, name):  # Frames of PyAV 14.1 lack some.
            setattr(coded, name, value)


def _picture(file: Path) -> Picture:
    """A frame in memory; no more than one file is open, of films of any length."""
    from PIL import Image

    with Image.open(file) as image:
        return image.convert("RGB")


def _frames_as_image(files: Sequence[Path]) -> Picture:
    """Files as the frames of one image, as Pillow has those of a GIF; read one at a time."""
    from PIL import Image

    class Frames(Image.Image):
        """Frame by frame."""

        n_frames = len(files)

        def __init__(self) -> None:
            super().__init__()
            self._place = -1
            self.seek(0)

        def seek(self, frame: int) -> None:
            """Read a frame."""
            if frame != self._place:
                picture = _picture(files[frame])
                self.im, self._mode, self._size = picture.im, picture.mode, picture.size
                self._place = frame

        def tell(self) -> int:
            """Number of the frame that is read."""
            return self._place

    return Frames()


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """A temporary file that gets its final name when it is complete."""
    partial = path.with_name(f".{path.name}.partial")
    with readable_write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield partial
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
