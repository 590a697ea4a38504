"""The compressed PLY of PlayCanvas and SuperSplat: 16 bytes a splat, and a byte per coefficient.

Splats lie along the Morton curve, in chunks of 256. A chunk has the bounds of its positions,
log-scales and colours; older files have no bounds of colours, which are then 0 and 1. A splat has
four words: position and log-scales as 11, 10 and 11 bits between the bounds, the smallest three of
its rotation as 10 bits each, its colour and opacity as 8 bits each. An element of its own has the
coefficients of SH degree 1 to 3, channel by channel, as bytes.

What is read differs from what was written by at most half a step, apart from rounding to float32:
in a chunk of extent e, e / 4094 along x and z and e / 2046 along y, for log-scales (kept between
-20 and 20) as for positions; e / 510 for a colour; 1 / 510 for an opacity; sqrt(2) / 2046 for each
of the smallest three. Coefficients in [-4, 4] differ by 1 / 64, 0 among them, and the outermost by
1 / 32.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Float64, UInt8, UInt32

from gsfw.core.errors import DataError
from gsfw.core.exchange import Exporter, ExportSource, Importer, SplatFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.files.ply_file import PlyHeader, Rows, ply_header, read_ply_header
from gsfw.formats.activation import dc_of, logits_of
from gsfw.formats.morton_order import morton_order
from gsfw.formats.ply import (
    COLUMNS,
    REST_COUNTS,
    is_packed,
    rest_degree,
    splat_comments,
    splat_file,
)
from gsfw.formats.smallest_three import from_smallest_three, smallest_three
from gsfw.formats.stored_rows import StoredRows, check_any, gathered, stored_parts

SIZE = 256
"""Splats of a chunk; the last one may have fewer."""
MAX_DEGREE = 3
PLACE_BITS = ((21, 11), (11, 10), (0, 11))
"""Shift and number of the bits of x, y and z, of positions and log-scales."""
ROTATION_BITS = ((20, 10), (10, 10), (0, 10))
"""Bits of the smallest three; the index of the largest, in wxyz, has the two bits above."""
COLOR_BITS = ((24, 8), (16, 8), (8, 8), (0, 8))
"""Bits of red, green, blue and opacity."""
MAX_LOG_SCALE = 20.0
"""Log-scales are kept within this, as in PlayCanvas: a scale of 0 must not widen the bounds."""
SH_RANGE = 8.0
"""Extent of the coefficients, around 0."""
COEFFICIENTS = (np.array([0, *(np.arange(1, 255) + 0.5), 256]) / 256 - 0.5).astype("f4") * SH_RANGE
"""Coefficients by byte: the middle of each step, but the ends of the outermost two."""
WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
BOUNDS = tuple(
    f"{end}_{kind}{axis}" for kind in ("", "scale_") for end in ("min", "max") for axis in "xyz"
)
COLOR_BOUNDS = tuple(f"{end}_{channel}" for end in ("min", "max") for channel in "rgb")


class CompressedPlyExporter(Exporter):
    """Writes files with bounds of colours, as SuperSplat 2 does."""

    suffix = ".compressed.ply"
    most_sh_degree = MAX_DEGREE

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; bands above the active SH degree, or above 3, are omitted.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        content = source.splat_file()
        check_any(content.splats)
        parts = stored_parts(content.splats, morton_order(content.splats.means))
        places: list[int] = []
        with atomic_file(path) as file:
            for part in parts:
                if not places:
                    header, places = _begin(content, min(part.degree, MAX_DEGREE))
                    file.write(header)
                for index, block in enumerate(_packed(part)):
                    file.seek(places[index])
                    file.write(block.data)
                    places[index] += block.nbytes


def _begin(content: SplatFile, degree: int) -> tuple[bytes, list[int]]:
    """The header, and where the rows of each of its elements begin."""
    count = len(content.splats)
    chunks, rest = -(-count // SIZE), COLUMNS["rest"][: REST_COUNTS[degree]]
    elements: dict[str, tuple[int, Sequence[tuple[str, str]]]] = {
        "chunk": (chunks, [("float", name) for name in (*BOUNDS, *COLOR_BOUNDS)]),
        "vertex": (count, [("uint", name) for name in WORDS]),
    }
    if rest:
        elements["sh"] = (count, [("uchar", name) for name in rest])
    header = ply_header(splat_comments(content, degree), elements)
    words = len(header) + 4 * len(BOUNDS + COLOR_BOUNDS) * chunks
    return header, [len(header), words, words + 4 * len(WORDS) * count]


def _packed(
    part: StoredRows,
) -> tuple[Float32[np.ndarray, "c 18"], UInt32[np.ndarray, "n 4"], UInt8[np.ndarray, "n r"]]:
    """The bounds of the chunks of some splats, their words, and their coefficients."""
    count = len(part)
    # The last splat fills the last chunk.
    whole = part.take(np.minimum(np.arange(-(-count // SIZE) * SIZE), count - 1))
    log_scales = whole.log_scales.clip(-MAX_LOG_SCALE, MAX_LOG_SCALE)
    (place_ends, places), (scale_ends, scales), (color_ends, colors) = (
        _within_bounds(values) for values in (whole.means, log_scales, whole.rgb)
    )
    largest, three = smallest_three(whole.quats.astype(np.float64))
    rotations = _joined(three * np.sqrt(0.5) + 0.5, ROTATION_BITS)
    words = [
        _joined(places, PLACE_BITS),
        rotations | largest.astype(np.uint32) << np.uint32(30),
        _joined(scales, PLACE_BITS),
        _joined(np.column_stack([colors, whole.opacities]), COLOR_BITS),
    ]
    rest = part.rest[:, : (MAX_DEGREE + 1) ** 2 - 1].transpose(0, 2, 1).reshape(count, -1)
    coefficients = ((rest / SH_RANGE + 0.5) * 256).clip(0, 255).astype(np.uint8)
    bounds = np.concatenate([place_ends, scale_ends, color_ends], axis=1)
    return bounds, np.stack(words, axis=1)[:count].astype("<u4"), coefficients


def _within_bounds(
    values: Float[np.ndarray, "n 3"],
) -> tuple[Float32[np.ndarray, "c 6"], Float64[np.ndarray, "n 3"]]:
    """The lowest and highest values of each chunk, and the values between them, in [0, 1]."""
    chunks = values.reshape(-1, SIZE, 3).astype(np.float64)
    bounds = np.concatenate([chunks.min(axis=1), chunks.max(axis=1)], axis=1).astype("<f4")
    low, high = (bounds[:, None, ends].astype(np.float64) for ends in (slice(3), slice(3, 6)))
    extent = np.where(high > low, high - low, 1)
    return bounds, ((chunks - low) / extent).clip(0, 1).reshape(-1, 3)


def _joined(
    values: Float64[np.ndarray, "n d"], bits: Sequence[tuple[int, int]]
) -> UInt32[np.ndarray, " n"]:
    """Words of values in [0, 1], each rounded to its number of bits."""
    words = np.zeros(len(values), dtype=np.uint32)
    for column, (shift, number) in zip(values.T, bits, strict=True):
        words |= (column * ((1 << number) - 1) + 0.5).astype(np.uint32) << np.uint32(shift)
    return words


def _parted(
    words: UInt32[np.ndarray, " n"], bits: Sequence[tuple[int, int]]
) -> Float64[np.ndarray, "n d"]:
    """The values in [0, 1] of words."""
    values = np.empty((len(words), len(bits)))
    for index, (shift, number) in enumerate(bits):
        mask = (1 << number) - 1
        values[:, index] = (words >> np.uint32(shift) & np.uint32(mask)) / mask
    return values


class CompressedPlyImporter(Importer):
    """Reads files of SuperSplat 1 and 2, with and without SH."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for every PLY whose vertices are packed."""
        return is_packed(path)

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged, or not packed as PlayCanvas does it.
        """
        header = read_ply_header(path)
        degree = _check_layout(header)
        count = header.elements["vertex"].count
        # Asked for here, where nothing is allocated yet: this checks the size of the file.
        vertices = header.rows("vertex")
        coefficients = header.rows("sh") if degree else None
        parts = _parts(header, vertices, coefficients, degree)
        return splat_file(header, *gathered(path, count, degree, parts))


def _check_layout(header: PlyHeader) -> int:
    """Refuse another layout; return the SH degree."""
    path, elements = header.path, header.elements
    chunk = header.names("chunk")
    wanted = {
        "chunk": (*BOUNDS, *(COLOR_BOUNDS if chunk & {*COLOR_BOUNDS} else ())),
        "vertex": WORDS,
    }
    for element, names in wanted.items():
        kind = "f4" if element == "chunk" else "u4"
        for name in names:
            if name not in header.names(element) or elements[element].kinds[name] != kind:
                raise DataError(
                    f"{path} is not a compressed PLY of PlayCanvas or SuperSplat: it has no "
                    f"element {element!r} with {name} as {'float' if kind == 'f4' else 'uint'}.",
                    "Convert it with the tool that made it.",
                )
    count = elements["vertex"].count
    if count == 0:
        raise DataError(f"{path} contains no splats: its header announces 0 vertices.")
    expected = {"chunk": -(-count // SIZE), "sh": count}
    for name, number in expected.items():
        if name in elements and elements[name].count != number:
            raise DataError(
                f"{path} is a damaged PLY: its header announces {elements[name].count} {name} "
                f"rows, and {number} belong to its {count} splats.",
                "Get the file again.",
            )
    degree = rest_degree(path, header.names("sh"), REST_COUNTS[: MAX_DEGREE + 1])
    wrong = [name for name, kind in elements["sh"].kinds.items() if kind != "u1"] if degree else []
    if wrong:
        raise DataError(f"{path}: expected a uchar as {wrong[0]}.", "Get the file again.")
    return degree


def _parts(
    header: PlyHeader, vertices: Iterator[Rows], coefficients: Iterator[Rows] | None, degree: int
) -> Iterator[StoredRows]:
    """The stored values of the file, part by part."""
    bounds = _bounds(header)
    first = 0
    alone = ((rows, None) for rows in vertices)
    # Strictly, so that both come to their end, where they close the file.
    both = alone if coefficients is None else zip(vertices, coefficients, strict=True)
    for rows, bands in both:
        end = first + len(rows)
        chunks = bounds[np.arange(first, end) // SIZE]
        yield _stored(rows, chunks, bands, degree)
        first = end


def _bounds(header: PlyHeader) -> Float64[np.ndarray, "c 3 2 3"]:
    """The bounds of each chunk: of positions, log-scales, colours; lowest, highest; by axis."""
    rows = np.concatenate([*header.rows("chunk")])
    names = [name for name in (*BOUNDS, *COLOR_BOUNDS) if name in header.names("chunk")]
    bounds = np.zeros((len(rows), 18))
    bounds[:, 15:] = 1  # Of colours, where the file has no bounds of them.
    # Signalling NaNs of damaged files give rows that are dropped.
    with np.errstate(invalid="ignore"):
        for index, name in enumerate(names):
            bounds[:, index] = rows[name]
    return bounds.reshape(-1, 3, 2, 3)


def _stored(
    rows: Rows, chunks: Float64[np.ndarray, "n 3 2 3"], coefficients: Rows | None, degree: int
) -> StoredRows:
    """The stored values of some rows of a file."""
    position, rotation, scale, color = (rows[name] for name in WORDS)
    colors = _parted(color, COLOR_BITS)
    three = (_parted(rotation, ROTATION_BITS) - 0.5) * np.sqrt(2)
    rest = np.zeros((len(rows), REST_COUNTS[degree]), dtype=np.float32)
    if coefficients is not None:
        for index, name in enumerate(COLUMNS["rest"][: REST_COUNTS[degree]]):
            rest[:, index] = COEFFICIENTS[coefficients[name]]
    return StoredRows(
        means=_between(chunks[:, 0], _parted(position, PLACE_BITS)),
        logits=logits_of(colors[:, 3]),
        log_scales=_between(chunks[:, 1], _parted(scale, PLACE_BITS)).astype(np.float32),
        quats=from_smallest_three((rotation >> np.uint32(30)).astype(np.intp), three).astype(
            np.float32
        ),
        dc=dc_of(_between(chunks[:, 2], colors[:, :3])),
        rest=rest.reshape(len(rows), 3, -1).transpose(0, 2, 1),
    )


def _between(
    ends: Float64[np.ndarray, "n 2 3"], parts: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    return ends[:, 0] * (1 - parts) + ends[:, 1] * parts
