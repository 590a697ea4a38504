"""Writes SOG version 2: codebooks for scales and colours, a palette for SH coefficients."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64, Int, UInt8, UInt16
from torch import Tensor

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource, SplatFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.maths.codebook import codebook, nearest_levels
from gsfw.core.splats import Splats
from gsfw.formats.morton_order import morton_order
from gsfw.formats.sog.container import META
from gsfw.formats.sog.description import MAX_PALETTE, Description, write_document
from gsfw.formats.sog.quantisation import pack_means, pack_opacities, pack_quats, to_logarithm
from gsfw.formats.sog.sh_palette import MAX_DEGREE, coded_sh, palette_size
from gsfw.formats.sog.texels import encode, image_shape
from gsfw.formats.stored_rows import check_any, stored_parts

MEANS_LOW, MEANS_HIGH, SCALES = "means_l.webp", "means_u.webp", "scales.webp"
QUATS, COLORS = "quats.webp", "sh0.webp"
CENTROIDS, LABELS = "shN_centroids.webp", "shN_labels.webp"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of the entries: the same splats give the same bytes."""


@dataclass(frozen=True)
class SogExporter(Exporter):
    """Writes a ``.sog``: a stored ZIP of lossless WebP images and their description."""

    palette: int = 0
    """Most vectors of SH coefficients that the splats share, up to 65,536. 0: as splat-transform
    has, the largest power of two that is at most the number of splats. They are the larger part of
    small files: fewer make the file smaller, more keep the colours."""

    suffix = ".sog"
    most_sh_degree = MAX_DEGREE

    def __post_init__(self) -> None:
        if not 0 <= self.palette <= MAX_PALETTE:
            raise ConfigError(
                f"format.palette={self.palette}: expected 1 to {MAX_PALETTE} vectors, or 0 for as "
                "many as are usual."
            )

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; SH bands above degree 3 are left out.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row. Or
                there are no splats, or more than an image holds.
        """
        files = sog_files(source.splat_file(), self.palette)
        with atomic_file(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
            for name, content in files.items():
                archive.writestr(zipfile.ZipInfo(name, EPOCH), content)


def sog_files(
    content: SplatFile, palette: int, order: Int[Tensor, " n"] | None = None
) -> dict[str, bytes]:
    """The description and the images by name.

    Args:
        content: the splats; SH bands above degree 3 are left out.
        palette: most vectors of SH coefficients, at most ``MAX_PALETTE``; 0 for the usual number.
        order: rows in the order of the images; ``None`` for that of the Morton curve.

    Raises:
        ValueError: as for ``SogExporter.write``.
    """
    splats = content.splats.up_to(MAX_DEGREE)
    check_any(splats)
    shape = image_shape(len(splats))
    order = morton_order(splats.means) if order is None else order
    columns = _columns(splats, order)
    scales, colors = codebook(columns.log_scales), codebook(columns.dc)
    shades = nearest_levels(columns.dc, colors)
    images = {
        MEANS_LOW: encode((columns.means & 255).astype(np.uint8), *shape),
        MEANS_HIGH: encode((columns.means >> 8).astype(np.uint8), *shape),
        QUATS: encode(columns.quats, *shape),
        SCALES: encode(nearest_levels(columns.log_scales, scales), *shape),
        COLORS: encode(np.concatenate([shades, columns.opacities[:, None]], axis=1), *shape),
    }
    sh = None
    if splats.sh_degree:
        sh = coded_sh(splats, order, palette or palette_size(len(splats)))
        images[CENTROIDS] = encode(sh.texels, *sh.shape)
        images[LABELS] = encode(sh.labels, *shape)
    description = Description(
        count=len(splats),
        antialiased=content.antialiased,
        low=columns.low,
        high=columns.high,
        means=(MEANS_LOW, MEANS_HIGH),
        quats=QUATS,
        scales=SCALES,
        scale_table=scales[:, None],
        colors=COLORS,
        color_table=colors[:, None],
        palette=None if sh is None else sh.described(CENTROIDS, LABELS),
    )
    return {META: write_document(description), **images}


@dataclass(frozen=True)
class _Columns:
    """All but the higher SH coefficients, in the order of the file."""

    low: Float64[np.ndarray, " 3"]
    high: Float64[np.ndarray, " 3"]
    means: UInt16[np.ndarray, "n 3"]
    quats: UInt8[np.ndarray, "n 4"]
    opacities: UInt8[np.ndarray, " n"]
    log_scales: Float32[np.ndarray, "n 3"]
    dc: Float32[np.ndarray, "n 3"]


def _columns(splats: Splats, order: Int[Tensor, " n"]) -> _Columns:
    count, means = len(splats), splats.means.double().numpy()
    columns = _Columns(
        low=to_logarithm(means.min(axis=0)),
        high=to_logarithm(means.max(axis=0)),
        means=np.empty((count, 3), dtype=np.uint16),
        quats=np.empty((count, 4), dtype=np.uint8),
        opacities=np.empty(count, dtype=np.uint8),
        log_scales=np.empty((count, 3), dtype=np.float32),
        dc=np.empty((count, 3), dtype=np.float32),
    )
    start = 0
    for part in stored_parts(splats, order):
        rows = slice(start, start + len(part))
        columns.means[rows] = pack_means(part.means, columns.low, columns.high)
        columns.quats[rows] = pack_quats(part.quats)
        columns.opacities[rows] = pack_opacities(part.logits)
        columns.log_scales[rows] = part.log_scales
        columns.dc[rows] = part.dc
        start += len(part)
    return columns
