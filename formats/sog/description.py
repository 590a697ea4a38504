"""The description of a SOG, meta.json: names of images, ranges and codebooks; both versions.

Version 1 has no codebooks: values lie in 255 even steps between two ends, and opacities are logits.
Version 2 was proposed with the flag ``antialias``, and has ``model`` now; both are written.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import parsed_json
from gsfw.formats.sog.container import CHOOSE, META, Container

KEYS = ("means", "scales", "quats", "sh0")
"""Entries that every SOG describes."""
VERSION = 2
MAX_META = 1 << 20
"""Longest description in bytes: four codebooks of 256 numbers take 20,000."""
PLAIN_NAME = re.compile(r"\w[\w .-]{0,199}", re.ASCII)
"""Names of images: none leaves the archive or the folder."""
ANTIALIASED, FLAT = "antialiased", "2dgs"
MAX_LOGARITHM = 80.0
"""Largest logarithm of a coordinate; that of float32's largest number is 88."""
MAX_PALETTE = 1 << 16
"""Most SH vectors: a label has 16 bits."""


@dataclass(frozen=True)
class ShPalette:
    """SH coefficients above the constant ones: vectors, and which one a splat has."""

    table: Float32[np.ndarray, "256 channels"]
    """The value of each byte in each channel: 3, or 1 for all."""
    centroids: str
    """Image of the vectors: 64 in a row, a texel for each coefficient."""
    labels: str
    """Image of the labels: low byte, high byte."""
    count: int | None
    """Number of vectors; ``None`` if only the image tells (version 1)."""
    degree: int | None
    """SH degree; ``None`` if only the image tells."""


@dataclass(frozen=True)
class Description:
    """Content of meta.json."""

    count: int
    """Number of splats."""
    antialiased: bool
    low: Float64[np.ndarray, " 3"]
    """Least logarithm of the means on each axis."""
    high: Float64[np.ndarray, " 3"]
    means: tuple[str, str]
    """Images of the low and of the high bytes."""
    quats: str
    scales: str
    scale_table: Float32[np.ndarray, "256 channels"]
    colors: str
    color_table: Float32[np.ndarray, "256 channels"]
    palette: ShPalette | None
    logit_table: Float32[np.ndarray, " 256"] | None = None
    """Logits of opacities in version 1; later ones store opacities in 255 steps."""
    version: int = VERSION
    generator: str = ""
    """The tool that wrote it; empty when unknown."""

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the images with a texel for each splat."""
        labels = () if self.palette is None else (self.palette.labels,)
        return (*self.means, self.quats, self.scales, self.colors, *labels)


def read_document(container: Container) -> dict[str, Any] | None:
    """The document of a container, if it describes a SOG.

    Raises:
        DataError: there is none, or it cannot be read.
    """
    name = container.description
    content = container.read(name, MAX_META)
    try:
        document = parsed_json(content)
    except ValueError as error:
        raise DataError(f"{container.path}: its {name} is damaged JSON.", COPY_AGAIN) from error
    described = isinstance(document, dict) and all(
        isinstance(document.get(key), dict) and "files" in document[key] for key in KEYS
    )
    return document if described else None


def read_description(container: Container) -> Description:
    """The checked description.

    Raises:
        DataError: it is damaged, of another version, or describes something else.
    """
    path, document = container.path, read_document(container)
    if document is None:
        raise DataError(
            f"{path} is no SOG: its {container.description} has no {', '.join(KEYS)} with files.",
            CHOOSE,
        )
    try:
        return _description(JsonFields(path, "", document, COPY_AGAIN))
    except RecursionError as error:
        raise DataError(f"{path}: its {META} is nested too deeply.", COPY_AGAIN) from error


def _description(fields: JsonFields) -> Description:
    values = fields.values
    number = fields.count("version", default=1)
    if number > VERSION:
        raise DataError(
            f"{fields.path} is a SOG of version {number}; gsfw reads 1 and {VERSION}.",
            "Convert it with the tool that wrote it, for example to PLY.",
        )
    legacy = number < VERSION
    means, quats, scales, colors = (
        fields.fields(key) for key in ("means", "quats", "scales", "sh0")
    )
    antialiased = values.get("model") == ANTIALIASED or values.get("antialias") is True
    if values.get("model") == FLAT:
        raise DataError(
            f"{fields.path} holds flat splats (2DGS), not 3D Gaussians.",
            "Export 3D Gaussians from the tool that made it.",
        )
    low_name, high_name = _files(means, 2)
    color_table = _even_steps(colors, 4) if legacy else _codebook(colors)
    return Description(
        version=number,
        count=_legacy_count(means) if legacy else fields.count("count", 1),
        antialiased=antialiased,
        generator=generator_of(values.get("asset")),
        low=_logarithms(means, "mins"),
        high=_logarithms(means, "maxs"),
        means=(low_name, high_name),
        quats=_files(quats, 1)[0],
        scales=_files(scales, 1)[0],
        scale_table=_even_steps(scales, 3) if legacy else _codebook(scales),
        colors=_files(colors, 1)[0],
        color_table=color_table[:, :3],
        logit_table=color_table[:, 3] if legacy else None,
        palette=_palette(fields.fields("shN"), legacy) if values.get("shN") else None,
    )


def _palette(fields: JsonFields, legacy: bool) -> ShPalette | None:
    """The palette; ``None`` for one of SH degree 0."""
    centroids, labels = _files(fields, 2)
    if legacy:
        return ShPalette(_even_steps(fields, 3), centroids, labels, None, None)
    degree, count = fields.count("bands"), fields.count("count", 1)
    if degree > 3 or count > MAX_PALETTE:
        raise DataError(
            f"{fields.path}: expected SH of degree 0 to 3 and up to {MAX_PALETTE} vectors of them, "
            f"found degree {degree} and {count}.",
            COPY_AGAIN,
        )
    return ShPalette(_codebook(fields), centroids, labels, count, degree) if degree else None


def _files(fields: JsonFields, count: int) -> list[str]:
    """Names of images."""
    names = fields.texts("files")
    if len(names) < count or not all(PLAIN_NAME.fullmatch(name) for name in names):
        raise DataError(
            f"{fields.path}: {fields.where}.files: expected {count} plain names of images beside "
            f"{META}.",
            COPY_AGAIN,
        )
    return names[:count]


def _legacy_count(means: JsonFields) -> int:
    """Number of splats in version 1: the first side of the means."""
    shape = means.numbers("shape", -1)
    if not len(shape) or not 1 <= shape[0] == int(shape[0]):
        raise DataError(
            f"{means.path}: means.shape: expected the number of splats, and 3.", COPY_AGAIN
        )
    return int(shape[0])


def _logarithms(means: JsonFields, name: str) -> Float64[np.ndarray, " 3"]:
    values = means.numbers(name, 3)
    if np.abs(values).max() > MAX_LOGARITHM:
        raise DataError(
            f"{means.path}: means.{name}: expected logarithms up to {MAX_LOGARITHM:g}.", COPY_AGAIN
        )
    return values


def _codebook(fields: JsonFields) -> Float32[np.ndarray, "256 1"]:
    """The codebook of version 2, the same for all channels."""
    with np.errstate(over="ignore"):  # Rows with infinite values are dropped, and counted.
        return fields.numbers("codebook", 256).astype(np.float32)[:, None]


def _even_steps(fields: JsonFields, channels: int) -> Float32[np.ndarray, "256 channels"]:
    """The values of version 1: one pair of ends, or one for each channel."""
    shape = (channels,) if isinstance(fields.values.get("mins"), list) else ()
    low, high = fields.numbers("mins", *shape), fields.numbers("maxs", *shape)
    part = np.linspace(0, 1, 256)[:, None]
    with np.errstate(over="ignore"):
        table = (low * (1 - part) + high * part).astype(np.float32)
    return np.broadcast_to(table, (256, channels))


def generator_of(asset: object) -> str:
    """The tool that an ``asset`` names; empty for none."""
    name = asset.get("generator") if isinstance(asset, dict) else None
    return name[:200] if isinstance(name, str) else ""


def write_document(description: Description) -> bytes:
    """The document of version 2."""
    files = "files"
    palette = description.palette
    document: dict[str, Any] = {
        "version": VERSION,
        "asset": {"generator": f"gsfw {version('gsfw')}"},
        "count": description.count,
        **({"model": ANTIALIASED, "antialias": True} if description.antialiased else {}),
        "means": {
            "mins": description.low.tolist(),
            "maxs": description.high.tolist(),
            files: list(description.means),
        },
        "scales": {"codebook": _short(description.scale_table), files: [description.scales]},
        "quats": {files: [description.quats]},
        "sh0": {"codebook": _short(description.color_table), files: [description.colors]},
    }
    if palette is not None:
        document["shN"] = {
            "count": palette.count,
            "bands": palette.degree,
            "codebook": _short(palette.table),
            files: [palette.centroids, palette.labels],
        }
    return json.dumps(document, separators=(",", ":")).encode()


def _short(table: Float32[np.ndarray, "256 channels"]) -> list[float]:
    """The levels with as few digits as float32 needs."""
    return [float(str(level)) for level in table[:, 0]]
