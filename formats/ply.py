"""The PLY layout of 3DGS: the format of Kerbl et al. 2023 and of every splat tool.

Opacities are stored as logits, scales as natural logarithms, rotations as unit wxyz, SH
coefficients channel by channel (all of red, then green, then blue). Tags are comments: Brush's and
splat-transform's ``SplatRenderMode``, Postshot's ``antialiased``, nerfstudio's ``Vertical axis``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import Exporter, ExportSource, Importer, SplatFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.files.ply_file import PlyHeader, Rows, is_ply, ply_header, read_ply_header
from gsfw.core.maths.axes import stated_axis
from gsfw.core.splats import Splats
from gsfw.formats.stored_rows import StoredRows, gathered, stored_parts

REST_COUNTS = (0, 9, 24, 45, 72)
"""Numbers of ``f_rest`` properties at SH degree 0 to 4."""
MEANS, NORMALS, DC = ("x", "y", "z"), ("nx", "ny", "nz"), ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES, QUATS = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
OPACITY = ("opacity",)
REQUIRED = (*MEANS, *DC, *OPACITY, *SCALES, *QUATS)
PACKED = "packed_position"
"""A property of compressed PLY files, which have an importer of their own."""

COLUMNS = {
    "means": MEANS,
    "normals": NORMALS,
    "dc": DC,
    "rest": tuple(f"f_rest_{index}" for index in range(REST_COUNTS[-1])),
    "logits": OPACITY,
    "log_scales": SCALES,
    "quats": QUATS,
}
"""The properties of each part of a record."""
ORDERS: Mapping[str, tuple[str, ...]] = {
    "reference": ("means", "normals", "dc", "rest", "logits", "log_scales", "quats"),
    "brush": ("means", "log_scales", "logits", "quats", "dc", "rest"),
}
"""The order of the parts by the name of the option."""


@dataclass(frozen=True)
class PlyExporter(Exporter):
    """Writes binary, little-endian files."""

    suffix = ".ply"

    order: Literal["reference", "brush"] = "reference"
    """Order of the properties: that of the reference implementation, with normals of zero, which
    every tool reads; or brush: that of Brush, without normals, 12 bytes a splat less, for Brush and
    for tools that read properties by their names."""

    positions: Literal["float", "double"] = "float"
    """Type of the positions: float, which every tool reads; or double, which keeps georeferenced
    coordinates of millions of metres exactly, for gsfw and for tools that heed the type."""

    def __post_init__(self) -> None:
        """Check the options.

        Raises:
            ConfigError: there is no such order, or no such type.
        """
        if self.positions not in ("float", "double"):
            raise ConfigError(f"format.positions={self.positions}: expected float or double.")
        if self.order not in ORDERS:
            raise ConfigError(f"format.order={self.order}: expected {' or '.join(ORDERS)}.")

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; bands above the active SH degree are omitted.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        content = source.splat_file()
        with atomic_file(path) as file:
            for number, part in enumerate(stored_parts(content.splats)):
                if number == 0:
                    file.write(self._header(content, part.degree))
                file.write(self._records(part).data)

    def _header(self, content: SplatFile, degree: int) -> bytes:
        counts = {"rest": REST_COUNTS[degree]}
        names = [name for key in ORDERS[self.order] for name in COLUMNS[key][: counts.get(key)]]
        kinds = [(self.positions if name in MEANS else "float", name) for name in names]
        vertices = (len(content.splats), kinds)
        return ply_header(splat_comments(content, degree), {"vertex": vertices})

    def _records(self, part: StoredRows) -> np.ndarray:
        """The records of some splats, in the order of the header."""
        count = len(part)
        parts = {
            "means": part.means,
            "normals": np.zeros((count, 3)),
            "dc": part.dc,
            "rest": part.rest.transpose(0, 2, 1).reshape(count, REST_COUNTS[part.degree]),
            "logits": part.logits[:, None],
            "log_scales": part.log_scales,
            "quats": part.quats,
        }
        columns = [parts[key] for key in ORDERS[self.order]]
        if self.positions == "float":
            return np.concatenate(columns, axis=1, dtype="<f4", casting="same_kind")
        assert ORDERS[self.order][0] == "means"
        rest = np.concatenate(columns[1:], axis=1, dtype="<f4", casting="same_kind")
        records = np.empty(count, [("means", "<f8", 3), ("rest", "<f4", rest.shape[1])])
        records["means"], records["rest"] = part.means, rest
        return records


def splat_comments(content: SplatFile, degree: int) -> list[str]:
    """The tags of a file, as other tools write and read them."""
    # Other text might end the line, and go on with a header of its own.
    up = stated_axis(content.up)
    return [
        f"Generated by gsfw {version('gsfw')}",
        f"SplatRenderMode: {'mip' if content.antialiased else 'default'}",
        f"antialiased {int(content.antialiased)}",
        f"SH degree: {degree}",
        *([f"Vertical axis: {up}"] if up else []),
    ]


def comment_tags(header: PlyHeader) -> dict[str, str]:
    """Comments of the form "key: value", "key:value" or "key value", in lower case.

    The value is the last word. Takes time in proportion to the header, whatever stands in it.
    """
    tags: dict[str, str] = {}
    for text in header.comments:
        words = text.lower().rsplit(maxsplit=1)
        pair = words[0].split(":", 1) if len(words) == 1 else words
        if len(pair) == 2:
            tags[pair[0].rstrip(": ")] = pair[1]
    return tags


class PlyImporter(Importer):
    """Reads properties by name, in any order; ignores further ones."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for every PLY, so that one without splats is refused with its own reason."""
        return is_ply(path) and not is_packed(path)

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged, no PLY, or holds other content than 3D Gaussians.
        """
        header = read_ply_header(path)
        degree = _check_layout(header)
        parts = (_stored(rows, degree) for rows in header.rows("vertex"))
        count = header.elements["vertex"].count
        return splat_file(header, *gathered(path, count, degree, parts))


def splat_file(header: PlyHeader, splats: Splats, dropped: int) -> SplatFile:
    """The content of a file with its tags."""
    tags = comment_tags(header)
    orders = {"": "text", "<": "binary, little-endian", ">": "binary, big-endian"}
    comments = {"comments": "; ".join(header.comments)} if header.comments else {}
    return SplatFile(
        splats,
        antialiased=tags.get("splatrendermode") == "mip" or tags.get("antialiased") == "1",
        up=stated_axis(tags.get("vertical axis")),
        properties={"encoding": orders[header.order], **comments},
        num_dropped=dropped,
    )


def is_packed(path: Path) -> bool:
    """True if a file is a compressed PLY; never raises."""
    try:
        return PACKED in read_ply_header(path).names("vertex")
    except DataError:
        return False


def _check_layout(header: PlyHeader) -> int:
    """Refuse content that is no set of 3D Gaussians; return the SH degree."""
    path, names = header.path, header.names("vertex")
    missing = [name for name in REQUIRED if name not in names]
    if not set(missing) & {*MEANS} and set(missing) >= {*SCALES, *QUATS, *OPACITY}:
        raise DataError(
            f"{path} holds points or a mesh, not splats: its vertices have no scales, rotations "
            "and opacities.",
            "Points to start training from belong to the data set (COLMAP's points3D, or "
            "ply_file_path in transforms.json); init=random needs none.",
        )
    if missing == ["scale_2"] or comment_tags(header).get("splatrendermode") == "2dgs":
        raise DataError(
            f"{path} holds flat splats (2DGS): they have two scales, 3D Gaussians three.",
            "Export 3D Gaussians from the tool that made it.",
        )
    if missing:
        raise DataError(
            f"{path} is not a 3DGS PLY: its vertices have no {', '.join(missing)}.",
            f"Expected: {', '.join(REQUIRED)}, and f_rest_0 to f_rest_N.",
        )
    wrong = [name for name in REQUIRED if name in header.elements["vertex"].lists]
    if wrong:
        raise DataError(f"{path}: expected one number as {wrong[0]}, found a list.")
    if header.elements["vertex"].count == 0:
        raise DataError(f"{path} contains no splats: its header announces 0 vertices.")
    return rest_degree(path, names, REST_COUNTS)


def rest_degree(path: Path, names: Iterable[str], counts: Sequence[int]) -> int:
    """The SH degree of the ``f_rest`` properties of an element.

    Raises:
        DataError: they are none of ``counts``, which are those of degree 0, 1, ...
    """
    rest = [name for name in names if name.startswith("f_rest_")]
    if len(rest) not in counts or not {*COLUMNS["rest"][: len(rest)]} <= {*rest}:
        listed = ", ".join(map(str, counts[:-1]))
        raise DataError(
            f"{path}: {len(rest)} f_rest properties belong to no SH degree.",
            f"Expected f_rest_0 to f_rest_N, in all {listed} or {counts[-1]} (degree 0 to "
            f"{len(counts) - 1}).",
        )
    return counts.index(len(rest))


def _stored(rows: Rows, degree: int) -> StoredRows:
    """The stored values of some rows of a file, gathered by name."""

    def columns(names: Sequence[str], kind: type[np.floating] = np.float32) -> np.ndarray:
        table = np.empty((len(rows), len(names)), dtype=kind)
        for index, name in enumerate(names):
            table[:, index] = rows[name]
        return table

    channels = columns(COLUMNS["rest"][: REST_COUNTS[degree]]).reshape(len(rows), 3, -1)
    return StoredRows(
        means=columns(MEANS, np.float64),
        logits=columns(OPACITY)[:, 0],
        log_scales=columns(SCALES),
        quats=columns(QUATS),
        dc=columns(DC),
        rest=channels.transpose(0, 2, 1),
    )
