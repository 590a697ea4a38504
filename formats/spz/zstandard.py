"""Zstandard, which version 4 of SPZ needs: the package that Python 3.14 has as compression.zstd."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from gsfw.core.errors import UnavailableError

LEVEL = 12
"""The level of the official encoder."""


class DamagedStreamError(Exception):
    """A stream is no Zstandard, is cut short, or holds more than is announced."""


def check_available(why: str) -> None:
    """Check that the package is there.

    Args:
        why: what needs it, as the beginning of the message.

    Raises:
        UnavailableError: it is missing.
    """
    try:
        import backports.zstd  # noqa: F401
    except ImportError:
        raise UnavailableError(
            f"{why} needs Zstandard, and the package backports.zstd is not installed.",
            "Install it with: pip install 'gsfw[spz]' (or: pip install backports.zstd). "
            "Versions 2 and 3 need nothing more.",
        ) from None


def compressed(parts: Iterable[bytes], size: int) -> Iterator[bytes]:
    """Compress ``size`` bytes, part by part."""
    from backports.zstd import ZstdCompressor

    encoder = ZstdCompressor(level=LEVEL)
    encoder.set_pledged_input_size(size)
    for part in parts:
        yield encoder.compress(part)
    yield encoder.flush()


def decompressed(data: bytes, size: int) -> bytes:
    """Exactly ``size`` bytes; never reserves more than that.

    Raises:
        DamagedStreamError: there are more or fewer, or they are damaged.
    """
    from backports.zstd import ZstdDecompressor, ZstdError

    decoder = ZstdDecompressor()
    try:
        content = decoder.decompress(data, max_length=size)
        if len(content) == size and not decoder.eof:
            # The end of the stream, if nothing else follows.
            content += decoder.decompress(b"", max_length=1)
    except (ZstdError, EOFError, MemoryError) as error:
        raise DamagedStreamError(str(error)) from None
    if len(content) != size or not decoder.eof or decoder.unused_data:
        raise DamagedStreamError(f"it does not hold {size} bytes")
    return content
