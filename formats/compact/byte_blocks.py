"""Byte blocks: sequences of bytes, each in LZMA or as it is, whose lengths the reader knows.

LZMA codes every literal bit with an adaptive binary model in a range coder (I. Pavlov; the SDK's
``lzma-specification.txt``). With no context bits (``lc = lp = pb = 0``) it is an adaptive order-0
entropy coder, with matches on top.
"""

from __future__ import annotations

import lzma
import struct

FILTERS = [
    {"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 1 << 20, "lc": 0, "lp": 0, "pb": 0},
]
"""The only filter of the format: it fixes the memory of the decoder, too."""
PLAIN = 1 << 31
"""Flag of a block that LZMA would not shorten."""
LENGTH = struct.Struct("<I")


def packed(content: bytes) -> bytes:
    """A block."""
    short = lzma.compress(content, format=lzma.FORMAT_RAW, filters=FILTERS)
    if len(short) < len(content):
        return LENGTH.pack(len(short)) + short
    return LENGTH.pack(len(content) | PLAIN) + content


class ByteReader:
    """Reads blocks and numbers from untrusted bytes, one after the other."""

    def __init__(self, content: bytes) -> None:
        self._content, self._place = memoryview(content), 0

    def take(self, count: int) -> bytes:
        """The next bytes.

        Raises:
            ValueError: there are fewer.
        """
        found = self._content[self._place : self._place + count]
        if len(found) < count:
            raise ValueError(f"{count} more bytes were expected, found {len(found)}")
        self._place += count
        return bytes(found)

    def unpacked(self, length: int) -> bytes:
        """The content of the next block, which has ``length`` bytes.

        Raises:
            ValueError: it is cut short, not LZMA, or of another length.
        """
        (size,) = LENGTH.unpack(self.take(LENGTH.size))
        if size & PLAIN:
            content = self.take(size & ~PLAIN)
        else:
            decoder = lzma.LZMADecompressor(format=lzma.FORMAT_RAW, filters=FILTERS)
            try:
                content = decoder.decompress(self.take(size), max_length=length + 1)
            except (lzma.LZMAError, EOFError) as error:
                raise ValueError(f"a block is not LZMA: {error}") from error
        if len(content) != length:
            raise ValueError(f"a block should have {length} bytes, found {len(content)}")
        return content

    def finish(self) -> None:
        """Check that nothing is left.

        Raises:
            ValueError: there is.
        """
        left = len(self._content) - self._place
        if left:
            raise ValueError(f"{left} bytes are left over")
