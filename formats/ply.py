"""The PLY layout of 3DGS: the format of Kerbl et al. 2023 and of every splat tool.

Opacities are stored as logits, scales as natural logarithms, rotations as unit wxyz, SH
coefficients channel by channel (all of red, then green, then blue). Tags are comments: Brush's and
splat-transform's ``SplatRenderMode``, Postshot's ``antialiased``, nerfstudio's ``Vertical axis``.

plyfile is GPL-3.0-or-later, gsfw is Apache-2.0: the README lists its uses.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64
from plyfile import PlyData, PlyElement, PlyListProperty, PlyParseError
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.exchange import Exporter, ExportSource, Importer, SplatFile
from gsfw.core.files.atomic import write_atomically
from gsfw.core.splats import Sh, Splats

MIN_LOGIT, MAX_LOGIT = -110.0, 20.0
"""Logits of opacities 0 and 1. Both are read back as 0 and 1 in float32, and every logit between
them survives sigmoid and logit in float64 to the last float32 bit; larger ones do not."""
MIN_LOG_SCALE = -110.0
"""Logarithm of a scale of 0; exp of it is 0 in float32."""
UNIT = 1e-6
"""Quaternions as near to unit length as this are stored and read unchanged: rounding to float32
changes them by less, and another normalisation would change their last bits."""
MAX_HEADER = 1 << 16
"""Longest header in bytes; the longest known layout has 3,000."""
REST_COUNTS = (0, 9, 24, 45, 72)
"""Numbers of ``f_rest`` properties at SH degree 0 to 4."""
MEANS, DC = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES, QUATS = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
REQUIRED = (*MEANS, *DC, "opacity", *SCALES, *QUATS)

MALFORMED = (PlyParseError, ValueError, KeyError, IndexError, OverflowError, MemoryError)
"""Errors of plyfile on malformed files."""


class PlyExporter(Exporter):
    """Writes the reference layout, binary little-endian, normals included."""

    suffix = ".ply"

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; bands above the active SH degree are omitted.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        content = source.splat_file()
        names, table = _table(content.splats)
        rows = np.ascontiguousarray(table, dtype="<f4").view([(name, "<f4") for name in names])
        vertex = PlyElement.describe(rows[:, 0], "vertex")
        buffer = io.BytesIO()
        PlyData([vertex], byte_order="<", comments=_comments(content)).write(buffer)
        write_atomically(path, buffer.getvalue())


def _table(splats: Splats) -> tuple[list[str], Float[np.ndarray, "n properties"]]:
    """Names and stored values of every property, in the reference order."""
    colors, quats, scales = splats.colors, splats.quats, splats.scales
    if not isinstance(colors, Sh) or quats is None or scales is None:
        raise ValueError("a PLY holds splats in quats-and-scales form with SH colours")
    coefficients = colors.dense().double()
    rest = coefficients[:, 1:].transpose(1, 2).flatten(1)
    opacities = splats.opacities.double()
    logits = (opacities.log() - (-opacities).log1p()).clamp(MIN_LOGIT, MAX_LOGIT)
    fields: list[tuple[str, Sequence[str], Tensor, Tensor]] = [
        ("means", MEANS, splats.means, splats.means),
        ("normals", ("nx", "ny", "nz"), torch.zeros_like(splats.means), splats.means),
        ("colors", DC, coefficients[:, 0], coefficients[:, 0]),
        ("colors", [f"f_rest_{index}" for index in range(rest.shape[1])], rest, rest),
        ("opacities", ["opacity"], logits[:, None], opacities[:, None]),
        ("scales", SCALES, scales.double().log().clamp_min(MIN_LOG_SCALE), scales),
        ("quats", QUATS, _unit(quats.double()), quats),
    ]
    for field, _, stored, given in fields:
        _check_storable(field, stored.float(), given)
    names = [name for _, group, _, _ in fields for name in group]
    return names, torch.cat([stored.float() for _, _, stored, _ in fields], dim=1).cpu().numpy()


def _check_storable(field: str, stored: Float[Tensor, "n p"], given: Float[Tensor, "n q"]) -> None:
    """Refuse NaN, infinities, overflows of float32, and opacities or scales out of range."""
    bad = (~stored.isfinite().all(dim=1)).nonzero()[:, 0]
    if len(bad):
        row = int(bad[0])
        values = ", ".join(f"{value:g}" for value in given[row].tolist())
        raise ValueError(
            f"{field}: row {row} is {values}, which a PLY cannot hold ({len(bad)} such rows)"
        )


def _unit(quats: Float64[Tensor, "n 4"]) -> Float64[Tensor, "n 4"]:
    """Quaternions of unit length; those of length 0 become the identity."""
    lengths = quats.norm(dim=1, keepdim=True)
    unit = torch.where((lengths - 1).abs() < UNIT, quats, quats / lengths)
    identity = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64, device=quats.device)
    return torch.where(lengths < 1e-12, identity, unit)


def _comments(content: SplatFile) -> list[str]:
    assert isinstance(content.splats.colors, Sh)
    return [
        f"Generated by gsfw {version('gsfw')}",
        f"SplatRenderMode: {'mip' if content.antialiased else 'default'}",
        f"antialiased {int(content.antialiased)}",
        f"SH degree: {content.splats.colors.degree}",
        *([f"Vertical axis: {content.up}"] if content.up else []),
    ]


class PlyImporter(Importer):
    """Reads properties by name, in any order; ignores further ones."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for every PLY, so that one without splats is refused with its own reason."""
        try:
            with path.open("rb") as file:
                return file.read(4) in (b"ply\n", b"ply\r")
        except OSError:
            return False

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged, no PLY, or holds other content than 3D Gaussians.
        """
        header = _read_header(path)
        degree = _check_layout(path, header)
        _check_size(path, header)
        try:
            rows = PlyData.read(str(path))["vertex"].data
        except MALFORMED as error:
            raise DataError(f"{path} is a damaged PLY: {_in_words(error)}.", _COPY) from error
        splats = _Columns(path, rows).splats(degree)
        tags = header.tags()
        mip = tags.get("splatrendermode") == "mip" or tags.get("antialiased") == "1"
        return SplatFile(
            splats,
            antialiased=mip,
            up=tags.get("vertical axis", ""),
            properties={
                "encoding": header.encoding,
                **({"comments": "; ".join(header.comments)} if header.comments else {}),
            },
        )


_COPY = "It may have been cut short or changed in copying; get it again."


@dataclass(frozen=True)
class _Header:
    """The header of a file."""

    encoding: str
    comments: tuple[str, ...]
    properties: Mapping[str, tuple[str, ...]]
    """Names of the properties of each element."""
    lists: frozenset[str]
    """Names of properties that are lists."""
    counts: Mapping[str, int]
    row_bytes: Mapping[str, int]
    """Least bytes that a row of each element takes."""
    data_bytes: int
    """Bytes after the header."""

    def tags(self) -> dict[str, str]:
        """Comments of the form "key: value" or "key value", in lower case."""
        pairs = (re.fullmatch(r"(.+?)(?::\s*|\s+)(\S+)", text.strip()) for text in self.comments)
        return {pair[1].lower(): pair[2].lower() for pair in pairs if pair}


def _read_header(path: Path) -> _Header:
    """Read the header alone: allocates nothing for its announced rows."""
    try:
        with path.open("rb") as file:
            start = file.read(MAX_HEADER)
        size = path.stat().st_size
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}.") from None
    if not start.startswith((b"ply\n", b"ply\r")):
        raise DataError(f"{path} is not a PLY file: it does not begin with 'ply'.")
    end = re.search(rb"[\r\n]end_header(\r\n|\n|\r)", start)
    if end is None:
        raise DataError(f"{path} is a damaged PLY: its header does not end.", _COPY)
    counts: list[int] = []

    def without_rows(element: re.Match[bytes]) -> bytes:
        counts.append(int(element[2]))
        return element[1] + b"0"

    try:
        text = re.sub(
            rb"([\r\n]element[ \t]+\S+[ \t]+)(\d+)(?=\s)", without_rows, start[: end.end()]
        )
        parsed = PlyData.read(io.BytesIO(text))
    except MALFORMED as error:
        raise DataError(f"{path} is a damaged PLY: {_in_words(error)}.", _COPY) from error
    return _header(parsed, counts, size - end.end())


def _header(parsed: PlyData, counts: Sequence[int], data_bytes: int) -> _Header:
    elements = parsed.elements
    order = {"<": "binary, little-endian", ">": "binary, big-endian"}
    every = [item for element in elements for item in element.properties]
    comments = [*parsed.comments, *(text for element in elements for text in element.comments)]
    return _Header(
        encoding="text" if parsed.text else order.get(parsed.byte_order, "binary"),
        comments=tuple(comments),
        properties={e.name: tuple(item.name for item in e.properties) for e in elements},
        lists=frozenset(item.name for item in every if isinstance(item, PlyListProperty)),
        counts={e.name: count for e, count in zip(elements, counts, strict=True)},
        row_bytes={e.name: _least_bytes(e, parsed.text) for e in elements},
        data_bytes=data_bytes,
    )


def _least_bytes(element: PlyElement, text: bool) -> int:
    """Least size of a row: a number in a text has a digit and a blank, a list its count."""
    if text:
        return 2 * len(element.properties)
    return sum(
        1 if isinstance(item, PlyListProperty) else np.dtype(item.dtype()).itemsize
        for item in element.properties
    )


def _check_layout(path: Path, header: _Header) -> int:
    """Refuse content that is no set of 3D Gaussians; return the SH degree."""
    names = header.properties.get("vertex", ())
    if "packed_position" in names:
        raise DataError(
            f"{path} is a compressed PLY of SuperSplat or PlayCanvas, which is not read here.",
            "Convert it first: npx @playcanvas/splat-transform IN.compressed.ply OUT.ply",
        )
    missing = [name for name in REQUIRED if name not in names]
    if not set(missing) & {*MEANS} and set(missing) >= {*SCALES, *QUATS, "opacity"}:
        raise DataError(
            f"{path} holds points or a mesh, not splats: its vertices have no scales, rotations "
            "and opacities.",
            "Points to start training from belong to the data set (COLMAP's points3D, or "
            "ply_file_path in transforms.json); init=random needs none.",
        )
    if missing == ["scale_2"] or header.tags().get("splatrendermode") == "2dgs":
        raise DataError(
            f"{path} holds flat splats (2DGS): they have two scales, 3D Gaussians three.",
            "Export 3D Gaussians from the tool that made it.",
        )
    if missing:
        raise DataError(
            f"{path} is not a 3DGS PLY: its vertices have no {', '.join(missing)}.",
            f"Expected: {', '.join(REQUIRED)}, and f_rest_0 to f_rest_N.",
        )
    wrong = [name for name in REQUIRED if name in header.lists]
    if wrong:
        raise DataError(f"{path}: expected one number as {wrong[0]}, found a list.")
    if header.counts["vertex"] == 0:
        raise DataError(f"{path} holds no splats: its header announces 0 vertices.")
    rest = sum(name.startswith("f_rest_") for name in names)
    if rest not in REST_COUNTS or any(f"f_rest_{index}" not in names for index in range(rest)):
        raise DataError(
            f"{path}: {rest} f_rest properties belong to no SH degree.",
            "Expected f_rest_0 to f_rest_N, in all 0, 9, 24, 45 or 72 (degree 0 to 4).",
        )
    return REST_COUNTS.index(rest)


def _check_size(path: Path, header: _Header) -> None:
    """Refuse a file that is shorter than its header states, before any allocation."""
    announced = sum(header.counts[name] * header.row_bytes[name] for name in header.counts)
    if announced > header.data_bytes:
        raise DataError(
            f"{path} is cut short: its header announces {header.counts['vertex']} splats, at least "
            f"{announced} bytes, and {header.data_bytes} follow.",
            _COPY,
        )


@dataclass(frozen=True)
class _Columns:
    """The rows of a file, property by property."""

    path: Path
    data: np.ndarray

    def read(self, names: Sequence[str]) -> Float64[Tensor, "n p"]:
        """Stack some properties, in float64."""
        columns = [np.asarray(self.data[name], dtype=np.float64) for name in names]
        stacked = np.stack(columns, axis=1) if columns else np.zeros((len(self.data), 0))
        return torch.from_numpy(stacked)

    def finite(self, names: Sequence[str], values: Float64[Tensor, "*b"]) -> Float64[Tensor, "*b"]:
        """Read the values of some properties, and check that they are finite.

        Raises:
            DataError: one is not finite.
        """
        bad = (~values.flatten(1).isfinite().all(dim=1)).nonzero()[:, 0]
        if len(bad):
            shown = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
            raise DataError(
                f"{self.path}: {shown} of row {int(bad[0])} is not finite ({len(bad)} such rows).",
                "Remove these rows in the tool that made the file.",
            )
        return values

    def splats(self, degree: int) -> Splats:
        """Activated splats.

        Raises:
            DataError: a value is not finite.
        """
        rest = [f"f_rest_{index}" for index in range(REST_COUNTS[degree])]
        by_channel = self.read(rest).view(len(self.data), 3, -1)
        coefficients = torch.cat([self.read(DC)[:, None], by_channel.transpose(1, 2)], dim=1)
        return Splats(
            means=self.finite(MEANS, self.read(MEANS)),
            opacities=self.finite(["opacity"], self.read(["opacity"]).sigmoid())[:, 0],
            scales=self.finite(SCALES, self.read(SCALES).exp()),
            quats=self.finite(QUATS, _unit(self.read(QUATS))),
            colors=Sh(self.finite([*DC, *rest], coefficients), degree),
        )


def _in_words(error: Exception) -> str:
    """The message of a parser, without its line breaks and full stop."""
    text = " ".join(str(error).split()).rstrip(".")
    return text or type(error).__name__
