"""HEIC files (ISO/IEC 23008-12) with one image, as phones write them."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest


def write_heic(
    path: Path,
    pixels: np.ndarray,
    exif: bytes = b"",
    profile: bytes = b"",
    turns: int = 0,
    transfer: int = 0,
) -> Path:
    """An image with EXIF data, a colour profile, and quarter turns counter-clockwise.

    With a transfer characteristic (ITU-T H.273) it has 10 bits, and primaries of BT.2020.
    """
    data, config = _hevc(pixels, transfer)
    height, width = pixels.shape[:2]
    properties = [
        _box(b"hvcC", config),
        _full(b"ispe", 0, struct.pack(">II", width, height)),
        *([_box(b"colr", b"prof", profile)] if profile else []),
        *([_box(b"colr", b"nclx", struct.pack(">3HB", 9, transfer, 9, 0))] if transfer else []),
        *([_box(b"irot", bytes([turns]))] if turns else []),
    ]
    items = [(1, b"hvc1", data)]
    if exif:
        items.append((2, b"Exif", struct.pack(">I", 0) + exif))
    head = _box(b"ftyp", b"heic", struct.pack(">I", 0), b"mif1heic")
    start = len(head) + len(_meta(items, properties, 0)) + 8
    content = _box(b"mdat", *(content for _, _, content in items))
    path.write_bytes(head + _meta(items, properties, start) + content)
    return path


def _hevc(pixels: np.ndarray, transfer: int) -> tuple[bytes, bytes]:
    """An image as HEVC encodes it, and its configuration record."""
    av = pytest.importorskip("av", reason="PyAV, which encodes HEVC, is not installed")
    height, width = pixels.shape[:2]
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        # With B frames, the time of a single image is left undefined, and at times not accepted.
        options = {"crf": "4", "x265-params": "log-level=error:bframes=0"}
        stream = container.add_stream("libx265", rate=1, options=options)
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuv420p10le" if transfer else "yuv420p"
        frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
        frame = frame.reformat(format=stream.pix_fmt, dst_colorspace=9 if transfer else None)
        frame.pts = 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    file.seek(0)
    with av.open(file) as container:
        (stream,) = container.streams.video
        packet = next(packet for packet in container.demux(stream) if packet.size)
        return bytes(packet), bytes(stream.codec_context.extradata)


def _meta(items: list[tuple[int, bytes, bytes]], properties: list[bytes], start: int) -> bytes:
    """The box that says what the items are, and where."""
    entries, places = [], []
    for number, kind, content in items:
        entries.append(_full(b"infe", 2, struct.pack(">HH4s", number, 0, kind), b"\0"))
        places.append(struct.pack(">HHHII", number, 0, 1, start, len(content)))
        start += len(content)
    # The first property is essential: nothing decodes without it.
    owned = bytes([0x81, *range(2, len(properties) + 1)])
    parts = [
        _full(b"hdlr", 0, struct.pack(">I4s12x", 0, b"pict"), b"\0"),
        _full(b"pitm", 0, struct.pack(">H", 1)),
        _full(b"iinf", 0, struct.pack(">H", len(items)), *entries),
        _full(b"iloc", 0, b"\x44\0", struct.pack(">H", len(items)), *places),
        _box(
            b"iprp",
            _box(b"ipco", *properties),
            _full(b"ipma", 0, struct.pack(">IHB", 1, 1, len(properties)), owned),
        ),
    ]
    if len(items) > 1:
        parts.append(_full(b"iref", 0, _box(b"cdsc", struct.pack(">HHH", 2, 1, 1))))
    return _full(b"meta", 0, *parts)


def _box(name: bytes, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack(">I4s", 8 + len(content), name) + content


def _full(name: bytes, version: int, *parts: bytes) -> bytes:
    return _box(name, struct.pack(">I", version << 24), *parts)
