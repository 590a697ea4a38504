"""Film: images on disk, and a sequence of them as one video."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gsfw.core.errors import UnavailableError
from gsfw.core.files.atomic import readable_write_errors, write_atomically

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor


VideoFormat = Literal["auto", "mp4", "webp", "none"]

CODEC = "libx264"
QUALITY = "18"
"""Constant rate factor of x264; at about 18 and below the loss is invisible."""


def write_image(path: Path, image: Float[Tensor, "h w 3"]) -> Path:
    """Write a PNG, whole or not at all; the path.

    Raises:
        OutputError: it cannot be written.
    """
    from PIL import Image

    values = (image.clamp(0, 1) * 255).round().byte().cpu().numpy()
    buffer = io.BytesIO()
    Image.fromarray(values).save(buffer, "PNG")
    write_atomically(path, buffer.getvalue())
    return path


def choose_format(asked: VideoFormat) -> VideoFormat:
    """The format for ``auto``: mp4 where its encoder is installed, else WebP.

    Raises:
        UnavailableError: mp4 was asked for, and there is no encoder.
    """
    if asked not in ("auto", "mp4"):
        return asked
    try:
        import av

        if CODEC in av.codecs_available:
            return "mp4"
        reason = f"the installed PyAV {av.__version__} has no {CODEC}"
    except ImportError:
        reason = "PyAV is not installed"
    if asked == "auto":
        return "webp"
    raise UnavailableError(
        f"video=mp4 needs an encoder, and {reason}.",
        "Install it with: pip install 'gsfw[video]' (or: pip install av). "
        "video=webp needs nothing more.",
    )


def write_film(stem: Path, frames: Sequence[Path], fps: int, chosen: VideoFormat) -> list[Path]:
    """Write the frames as one video; the files, no file for the format ``none``.

    Args:
        stem: its path without extension.
        frames: PNG files of one size, in order.
        fps: frames per second.
        chosen: as ``choose_format`` returns it.

    Raises:
        OutputError: it cannot be written.
    """
    if chosen == "none":
        return []
    path = stem.with_name(f"{stem.name}.{chosen}")
    if chosen == "mp4":
        _write_mp4(path, frames, fps)
    else:
        _write_webp(path, frames, fps)
    return [path]


def _write_webp(path: Path, frames: Sequence[Path], fps: int) -> None:
    """An animated WebP, which browsers show."""
    from PIL import Image

    images = [Image.open(frame) for frame in frames]
    buffer = io.BytesIO()
    images[0].save(
        buffer,
        "WEBP",
        save_all=True,
        append_images=images[1:],
        duration=round(1000 / fps),
        loop=0,
    )
    for image in images:
        image.close()
    write_atomically(path, buffer.getvalue())


def _write_mp4(path: Path, frames: Sequence[Path], fps: int) -> None:
    """H.264, which every player shows; an odd last row or column is left out, as it demands."""
    import av
    from PIL import Image

    with _partial(path) as partial, av.open(str(partial), "w", format="mp4") as container:
        stream = container.add_stream(CODEC, rate=fps, options={"crf": QUALITY})
        stream.pix_fmt = "yuv420p"
        for number, frame in enumerate(frames):
            with Image.open(frame) as image:
                width, height = (max(side // 2 * 2, 2) for side in image.size)
                if number == 0:
                    stream.width, stream.height = width, height
                even = image.convert("RGB").crop((0, 0, width, height))
            container.mux(stream.encode(av.VideoFrame.from_image(even)))
        container.mux(stream.encode())


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
