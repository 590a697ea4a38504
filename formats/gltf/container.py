"""The container of .glb files: a header, a chunk of JSON, and a chunk of binary data."""

from __future__ import annotations

from gsfw.formats.gltf.layout import BINARY_CHUNK, CHUNK, GLB_HEADER, JSON_CHUNK, MAGIC


def padded_text(text: str) -> bytes:
    """JSON with blanks up to a multiple of 4 bytes, which the format asks for."""
    content = text.encode()
    return content + b" " * (-len(content) % 4)


def glb_size(text: bytes, binary: int) -> int:
    """Bytes of a file with this padded JSON and so many bytes of binary data."""
    return GLB_HEADER.size + 2 * CHUNK.size + len(text) + binary


def glb_start(text: bytes, binary: int) -> bytes:
    """All of a file before its binary data; it holds at most 2^32 - 1 bytes."""
    header = GLB_HEADER.pack(MAGIC, 2, glb_size(text, binary))
    return header + CHUNK.pack(len(text), JSON_CHUNK) + text + CHUNK.pack(binary, BINARY_CHUNK)
