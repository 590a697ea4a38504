"""Document: a .glb or .gltf file, its JSON and its buffers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float64

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.reading import readable
from gsfw.formats.gltf.buffers import Buffers
from gsfw.formats.gltf.layout import (
    BINARY_CHUNK,
    CHUNK,
    COMPONENTS,
    EXTENSION,
    GLB_HEADER,
    JSON_CHUNK,
    MAGIC,
    WIDTHS,
)

MOST_JSON = 1 << 24
"""Bytes of a document: files of splats have a few thousand, large worlds of meshes some million."""

READ = {EXTENSION, "KHR_mesh_quantization"}
"""Extensions that are read, where a file requires some."""


@dataclass(frozen=True)
class Document:
    """The content of a file; buffers are read when they are asked for."""

    root: JsonFields
    """The JSON."""
    binary: bytes
    """The binary chunk of a .glb."""

    @cached_property
    def _lists(self) -> dict[str, list[JsonFields]]:
        names = ("accessors", "bufferViews")
        return {name: self.root.objects(name, default=[]) for name in names}

    @cached_property
    def buffers(self) -> Buffers:
        """The bytes of the file and of those beside it."""
        return Buffers(self.root.objects("buffers", default=[]), self.binary)

    def values(self, index: int, kind: str, where: str) -> Float64[np.ndarray, "n width"]:
        """The numbers of an accessor, normalised ones as fractions.

        Args:
            index: number of the accessor.
            kind: "SCALAR", "VEC3" or "VEC4", which it has to be.
            where: the attribute, for messages.

        Raises:
            DataError: there is no such accessor, or it is of another kind, or it reaches beyond its
                buffer.
        """
        accessors = self._lists["accessors"]
        path = self.root.path
        if index >= len(accessors):
            raise DataError(f"{path}: {where} is accessor {index}, which there is not.", COPY_AGAIN)
        accessor = accessors[index]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise DataError(
                f"{path}: {where} is stored sparsely, or compressed by an extension that is not "
                "read here.",
                "Export plain float32 accessors from the tool that made it.",
            )
        component = COMPONENTS.get(accessor.count("componentType"))
        if component is None or accessor.text("type") != kind:
            raise DataError(
                f"{path}: {where}: expected {kind} of bytes, shorts or floats, found "
                f"{accessor.text('type')} of component type {accessor.count('componentType')}.",
                COPY_AGAIN,
            )
        stored = self._stored(accessor, component, WIDTHS[kind], where)
        values = stored.astype(np.float64)
        if accessor.values.get("normalized") is True and component.kind in "iu":
            values = np.maximum(values / np.iinfo(component).max, -1)
        return values

    def _stored(
        self, accessor: JsonFields, component: np.dtype[Any], width: int, where: str
    ) -> np.ndarray:
        """The numbers as they are in the buffer."""
        view = accessor.pick("bufferView", self._lists["bufferViews"])
        view.pick("buffer", self.buffers.stated)
        data = self.buffers.content(view.count("buffer"))
        first, length = view.count("byteOffset", default=0), view.count("byteLength")
        offset, count = accessor.count("byteOffset", default=0), accessor.count("count")
        item = width * component.itemsize
        stride = view.count("byteStride", default=0) or item
        end = offset + stride * (count - 1) + item
        if not count or end > length or first + length > len(data) or stride < item:
            raise DataError(
                f"{self.root.path}: {where} has {count} values of {item} bytes, which do not lie "
                f"in its buffer of {len(data)} bytes.",
                COPY_AGAIN,
            )
        return np.ndarray(
            (count, width), component, data, first + offset, (stride, component.itemsize)
        )


def read_document(path: Path, binary: bool = True) -> Document:
    """Read a file.

    Args:
        path: the file.
        binary: false to leave the binary chunk of a .glb out, which is most of the file.

    Raises:
        DataError: it is damaged, of another kind, or requires extensions that are not read.
    """
    with readable(path), path.open("rb") as file:
        size = path.stat().st_size
        start = file.read(GLB_HEADER.size + CHUNK.size)
        if start.startswith(MAGIC):
            text = _json_chunk(path, start, file, size)
            values = _binary_chunk(file, size) if binary else b""
        else:
            text, values = start + file.read(min(size, MOST_JSON)), b""
    if not start.startswith(MAGIC) and text.lstrip()[:1] != b"{":
        raise DataError(f"{path} is no glTF file: it begins neither with 'glTF' nor with '{{'.")
    root = _parsed(path, text)
    required = root.values.get("extensionsRequired", [])
    unread = [name for name in required if name not in READ] if isinstance(required, list) else []
    if unread:
        raise DataError(
            f"{path} requires {unread[0]}, an extension of glTF that is not read here.",
            "Export it without compression from the tool that made it.",
        )
    return Document(root, values)


def _json_chunk(path: Path, start: bytes, file: BinaryIO, size: int) -> bytes:
    """The JSON of a .glb, whose header is read."""
    if len(start) < GLB_HEADER.size + CHUNK.size:
        raise DataError(f"{path} is cut short: it has {len(start)} bytes.", COPY_AGAIN)
    _, version, length = GLB_HEADER.unpack_from(start)
    if version != 2:
        raise DataError(f"{path} is glTF of version {version}; version 2 is read.")
    count, kind = CHUNK.unpack_from(start, GLB_HEADER.size)
    announced = max(length, len(start) + count)
    if announced > size:
        raise DataError(
            f"{path} is cut short: its header announces {announced} bytes, and it has {size}.",
            COPY_AGAIN,
        )
    if kind != JSON_CHUNK:
        raise DataError(f"{path} is a damaged .glb file: it does not begin with JSON.", COPY_AGAIN)
    return file.read(count)


def _binary_chunk(file: BinaryIO, size: int) -> bytes:
    """The binary chunk of a .glb, whose JSON is read; empty for none."""
    header = file.read(CHUNK.size)
    if len(header) < CHUNK.size:
        return b""
    count, kind = CHUNK.unpack(header)
    return file.read(min(count, size)) if kind == BINARY_CHUNK else b""


def _parsed(path: Path, text: bytes) -> JsonFields:
    """The object that a JSON text is.

    Raises:
        DataError: it is none, or too large, or nested too deeply.
    """
    if len(text) > MOST_JSON:
        raise DataError(
            f"{path}: its JSON has {len(text)} bytes, and {MOST_JSON} are read.",
            "Export the splats alone from the tool that made it.",
        )
    try:
        values = parsed_json(text)
    except ValueError as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise DataError(f"{path} has damaged JSON: {reason}.", COPY_AGAIN) from None
    if not isinstance(values, dict):
        raise DataError(f"{path} has damaged JSON: it is no object.", COPY_AGAIN)
    return JsonFields(path, "", values, COPY_AGAIN, "JSON")
