"""Small videos on disk, made as tests need them, and rings of cameras that see several times."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from support.small_captures import HEIGHT, WIDTH, SmallCapture, ring


def shade(number: int) -> int:
    """How bright image ``number`` of a video is, so that it can be told from the others."""
    return 40 + 12 * number


def image(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """What image ``number`` shows: its shade, darker towards the right, with a bright corner."""
    pixels = np.full((height, width, 3), shade(number), np.int64)
    pixels -= (np.arange(width) * 16 // width)[None, :, None]
    pixels[: height // 4, : width // 4] = 220
    return pixels.clip(0, 255).astype(np.uint8)


def write_video(
    path: Path,
    count=10,
    width=WIDTH,
    height=HEIGHT,
    rate=30,
    key_every=4,
    stamps=None,
    index_first=True,
    draw=image,
) -> Path:
    """H.264 with B frames, as cameras and editors write it; ``stamps`` in units of an image."""
    av = pytest.importorskip("av", reason="PyAV, which makes and reads videos, is not installed")
    path.parent.mkdir(parents=True, exist_ok=True)
    settings = {"qp": "4", "bf": "2", "g": str(key_every), "keyint_min": "1", "sc_threshold": "0"}
    flags = {"movflags": "+faststart"} if index_first else {}
    with av.open(str(path), "w", options=flags) as container:
        stream = container.add_stream("libx264", rate=rate, options=settings)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, rate)
        for number in range(count):
            frame = av.VideoFrame.from_ndarray(draw(number, width, height), format="rgb24")
            frame.pts = number if stamps is None else stamps[number]
            frame.time_base = Fraction(1, rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def over_time(capture: SmallCapture, names: list[list[str]]) -> SmallCapture:
    """The same cameras at several times: ``names`` has those of each camera's images."""
    return replace(
        capture,
        poses=[pose for pose, own in zip(capture.poses, names, strict=True) for _ in own],
        names=[name for own in names for name in own],
    )


def cameras(count: int = 3) -> SmallCapture:
    """Cameras on a ring, with the names that recordings give them."""
    return replace(ring(count), names=[f"cam{number:02d}" for number in range(count)])
