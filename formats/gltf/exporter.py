"""GltfExporter: writes .glb with one mesh of splats."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.metadata import version
from itertools import accumulate, chain
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from gsfw.core.exchange import Exporter, ExportSource, SplatFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.core.splats import Splats
from gsfw.formats.activation import to_bytes
from gsfw.formats.gltf.layout import (
    ARRAY_BUFFER,
    COLOR_SPACE,
    COMPONENTS,
    EXTENSION,
    FLOAT,
    MOST_DEGREE,
    OPACITY,
    POINTS,
    ROTATION,
    SCALE,
    UNSIGNED_BYTE,
    WIDTHS,
    coefficient,
    glb_size,
    glb_start,
    padded_text,
)
from gsfw.formats.stored_rows import RDF_TO_LUF, StoredRows, stored_parts

MOST_BYTES = 2**32 - 1
"""Largest .glb: its length is a 32-bit number."""


@dataclass(frozen=True)
class _Attribute:
    """One attribute of the points."""

    name: str
    kind: str
    component: int = FLOAT

    @property
    def width(self) -> int:
        """Bytes of one value: a multiple of 4, which the format asks for."""
        return WIDTHS[self.kind] * COMPONENTS[self.component].itemsize


class GltfExporter(Exporter):
    """Writes float32 values; viewers without the extension show coloured points."""

    suffix = ".glb"
    most_sh_degree = MOST_DEGREE

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; SH bands above degree 3 are left out.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range, or there are too many splats for
                the format; names the field and the row.
        """
        content = source.splat_file()
        splats = content.splats.up_to(MOST_DEGREE)
        parts = stored_parts(splats)
        first = next(parts)  # Refuses what the header would not hold.
        attributes = _attributes(splats.sh_degree)
        places = list(accumulate((len(splats) * item.width for item in attributes), initial=0))
        text = _document(content, splats, attributes, places)
        size = glb_size(text, places[-1])
        if size > MOST_BYTES:
            raise ValueError(
                f"{len(splats)} splats take {size} bytes, and a .glb holds "
                f"{MOST_BYTES}; write fewer splats or SH bands, or format=ply"
            )
        with atomic_file(path) as file:
            start = file.write(glb_start(text, places[-1]))
            row = 0
            for part in chain([first], parts):
                values = _values(part.mirrored(RDF_TO_LUF))
                for item, place, array in zip(attributes, places, values, strict=False):
                    file.seek(start + place + row * item.width)
                    file.write(array.tobytes())
                row += len(part)


def _attributes(degree: int) -> list[_Attribute]:
    """All attributes in the order of the file."""
    return [
        _Attribute("POSITION", "VEC3"),
        _Attribute("COLOR_0", "VEC4", UNSIGNED_BYTE),
        _Attribute(ROTATION, "VEC4"),
        _Attribute(SCALE, "VEC3"),
        _Attribute(OPACITY, "SCALAR"),
        *(_Attribute(coefficient(index), "VEC3") for index in range(num_coefficients(degree))),
    ]


def _values(rows: StoredRows) -> list[np.ndarray]:
    """The values of some splats, one array for each attribute."""
    return [
        rows.means.astype("<f4"),
        _fallback(rows),
        np.roll(rows.quats, -1, axis=1),
        np.exp(rows.log_scales),
        rows.opacities.astype("<f4"),
        rows.dc,
        *(rows.rest[:, index] for index in range(rows.rest.shape[1])),
    ]


def _fallback(rows: StoredRows) -> UInt8[np.ndarray, "n 4"]:
    """Colours of points: linear, where those of splats are sRGB (IEC 61966-2-1)."""
    rgb = rows.rgb.clip(0, 1)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return to_bytes(np.concatenate([linear, rows.opacities[:, None]], axis=1) * 255)


def _document(
    content: SplatFile, splats: Splats, attributes: list[_Attribute], places: list[int]
) -> bytes:
    """The JSON, padded with blanks to a multiple of 4 bytes."""
    accessors: list[dict[str, Any]] = [
        {
            "bufferView": index,
            "componentType": item.component,
            "count": len(splats),
            "type": item.kind,
            **({"normalized": True} if item.component != FLOAT else {}),
        }
        for index, item in enumerate(attributes)
    ]
    means = splats.means.float().numpy() * np.array(RDF_TO_LUF, dtype=np.float32)
    accessors[0]["min"] = means.min(axis=0).tolist()
    accessors[0]["max"] = means.max(axis=0).tolist()
    views = [
        {
            "buffer": 0,
            "byteOffset": place,
            "byteLength": len(splats) * item.width,
            "target": ARRAY_BUFFER,
        }
        for item, place in zip(attributes, places, strict=False)
    ]
    # The format has no place for either statement.
    stated = {"antialiased": content.antialiased, "up": content.up}
    asset = {
        "version": "2.0",
        "generator": f"gsfw {version('gsfw')}",
        "extras": {"gsfw": stated},
    }
    document = {
        "asset": asset,
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [_primitive(attributes)]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": places[-1]}],
    }
    return padded_text(json.dumps(document, separators=(",", ":")))


def _primitive(attributes: list[_Attribute]) -> dict[str, Any]:
    """The splats of the mesh: accessor i is attribute i."""
    splatting = {
        "kernel": "ellipse",
        "colorSpace": COLOR_SPACE,
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    }
    return {
        "attributes": {item.name: index for index, item in enumerate(attributes)},
        "mode": POINTS,
        "extensions": {EXTENSION: splatting},
    }
