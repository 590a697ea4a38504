"""StoredRows: splats as nearly all formats store them: logits, logarithms, SH coefficients.

Writers take them part by part, so that a file of any size needs memory for one part; readers
return them, and their rows are activated and checked here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, Int
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.maths.rotations import unit_quaternions
from gsfw.core.maths.spherical_harmonics import C0, degree_of, mirror_signs
from gsfw.core.numerics import MAX_LOG_SCALE
from gsfw.core.splats import Sh, Splats

CHUNK = 1 << 16
"""Rows of a part: 15 MB at degree 3."""
MIN_LOGIT, MAX_LOGIT = -110.0, 20.0
"""Logits of opacities 0 and 1. Both are read back as 0 and 1 in float32, and every logit between
them survives sigmoid and logit in float64 to the last float32 bit; larger ones do not."""
MIN_LOG_SCALE = -110.0
"""Logarithm of a scale of 0: exp of it is 0 in float32."""
MAX_COORDINATE = float(np.finfo(np.float32).max)
"""Coordinates above this, as files in double precision may have them, become infinite."""

Signs = tuple[float, float, float]
RDF_TO_RUB: Signs = (1.0, -1.0, -1.0)
"""From x right, y down, z forward (COLMAP, PLY) to x right, y up, z back (SPZ), and back."""
RDF_TO_LUF: Signs = (-1.0, -1.0, 1.0)
"""From x right, y down, z forward to x left, y up, z forward (glTF), and back."""


@dataclass(frozen=True)
class StoredRows:
    """The stored values of ``n`` splats."""

    means: Float64[np.ndarray, "n 3"]
    logits: Float32[np.ndarray, " n"]
    """Logits of the opacities."""
    log_scales: Float32[np.ndarray, "n 3"]
    """Natural logarithms."""
    quats: Float32[np.ndarray, "n 4"]
    """Unit quaternions, wxyz."""
    dc: Float32[np.ndarray, "n 3"]
    """The constant SH coefficient of each channel."""
    rest: Float32[np.ndarray, "n k_minus_1 3"]
    """The other SH coefficients, coefficient by coefficient."""

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Degree of the SH colours."""
        return degree_of(1 + self.rest.shape[1])

    @property
    def opacities(self) -> Float64[np.ndarray, " n"]:
        """The opacities, in [0, 1]."""
        return 1 / (1 + np.exp(-self.logits.astype(np.float64)))

    @property
    def rgb(self) -> Float64[np.ndarray, "n 3"]:
        """The colours of the constant coefficients, not clamped."""
        return 0.5 + C0 * self.dc.astype(np.float64)

    def take(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " r"] | slice) -> StoredRows:
        """Some of the rows; views of them for a slice."""
        return StoredRows(*(getattr(self, field.name)[rows] for field in fields(self)))

    @staticmethod
    def cat(parts: Sequence[StoredRows]) -> StoredRows:
        """The rows of several parts, one after the other; zeros are the bands that a part lacks."""
        width = max(part.rest.shape[1] for part in parts)
        bands = [
            np.pad(part.rest, ((0, 0), (0, width - part.rest.shape[1]), (0, 0))) for part in parts
        ]
        return StoredRows(
            means=np.concatenate([part.means for part in parts]),
            logits=np.concatenate([part.logits for part in parts]),
            log_scales=np.concatenate([part.log_scales for part in parts]),
            quats=np.concatenate([part.quats for part in parts]),
            dc=np.concatenate([part.dc for part in parts]),
            rest=np.concatenate(bands),
        )

    def mirrored(self, signs: Signs) -> StoredRows:
        """The same splats in a frame whose axes have other signs (a rotation: two or none)."""
        x, y, z = signs
        turned = np.array([1.0, y * z, x * z, x * y], dtype=np.float32)
        shades = mirror_signs(self.degree, signs).numpy().astype(np.float32)
        with np.errstate(invalid="ignore"):  # Signalling NaNs of damaged files: dropped later.
            return StoredRows(
                means=self.means * np.array(signs),
                logits=self.logits,
                log_scales=self.log_scales,
                quats=self.quats * turned,
                dc=self.dc,
                rest=self.rest * shades[1:, None],
            )


def stored_parts(
    splats: Splats, order: Int[Tensor, " n"] | None = None, chunk: int = CHUNK
) -> Iterator[StoredRows]:
    """The stored values of splats, part by part, in the order of the rows or of ``order``.

    Args:
        splats: those of a ``SplatFile``.
        order: rows in the order of the file; ``None`` for their own.
        chunk: rows of a part.

    Raises:
        ValueError: a value is not finite, or out of range; names the field and the row; or there
            are no splats.
    """
    check_any(splats)
    if not isinstance(splats.colors, Sh) or splats.quats is None or splats.scales is None:
        raise ValueError("files hold splats in quats-and-scales form with SH colours")
    count = len(splats) if order is None else len(order)
    for first in range(0, count, chunk):
        end = min(first + chunk, count)
        rows = torch.arange(first, end) if order is None else order[first:end]
        yield _stored(splats.take(rows), rows)


def check_any(splats: Splats) -> None:
    """Refuse to write a file of no splats, which no tool opens.

    Raises:
        ValueError: there are none.
    """
    if not len(splats):
        raise ValueError("there are no splats to write")


def _stored(splats: Splats, rows: Int[Tensor, " n"]) -> StoredRows:
    """The stored values of a few splats, which are ``rows`` of all."""
    colors, quats, scales = splats.colors, splats.quats, splats.scales
    assert isinstance(colors, Sh) and quats is not None and scales is not None  # noqa: PT018
    coefficients, opacities = colors.dense().float(), splats.opacities.double()
    logits = (opacities.log() - (-opacities).log1p()).clamp(MIN_LOGIT, MAX_LOGIT).float()
    log_scales = scales.double().log().clamp_min(MIN_LOG_SCALE).float()
    units = unit_quaternions(quats.double()).float()
    for field, stored, given in (
        ("means", splats.means.float(), splats.means),
        ("colors", coefficients.flatten(1), coefficients.flatten(1)),
        ("opacities", logits[:, None], opacities[:, None]),
        ("scales", log_scales, scales),
        ("quats", units, quats),
    ):
        _check_storable(field, stored, given, rows)
    return StoredRows(
        means=splats.means.double().numpy(),
        logits=logits.numpy(),
        log_scales=log_scales.numpy(),
        quats=units.numpy(),
        dc=coefficients[:, 0].numpy(),
        rest=coefficients[:, 1:].numpy(),
    )


def _check_storable(
    field: str,
    stored: Float[Tensor, "n p"],
    given: Float[Tensor, "n q"],
    rows: Int[Tensor, " n"],
) -> None:
    """Refuse NaN, infinities, overflows of float32, and opacities or scales out of range."""
    bad = (~stored.isfinite().all(dim=1)).nonzero()[:, 0]
    if len(bad):
        values = ", ".join(f"{value:g}" for value in given[bad[0]].tolist())
        raise ValueError(
            f"{field}: row {int(rows[bad[0]])} is {values}, which a file cannot hold "
            f"({len(bad)} such rows)"
        )


def activated(path: Path, rows: StoredRows) -> tuple[Splats, int]:
    """The splats of stored values, and the number of rows that were dropped: not finite.

    Args:
        path: the file, for messages.
        rows: all rows of the file.

    Raises:
        DataError: no row is finite, or there is none.
    """
    firsts = range(0, len(rows), CHUNK)
    parts = (rows.take(slice(first, first + CHUNK)) for first in firsts)
    return gathered(path, len(rows), rows.degree, parts)


def gathered(
    path: Path, count: int, degree: int, parts: Iterable[StoredRows]
) -> tuple[Splats, int]:
    """The splats of a file that is read part by part, and the number of rows that were dropped.

    Needs memory for the splats and for one part.

    Args:
        path: the file, for messages.
        count: number of rows of all parts; the file must be known to have as many.
        degree: degree of the SH colours.
        parts: the stored values in the order of the file.

    Raises:
        DataError: no row is finite, or there is none.
    """
    whole = Splats(
        means=torch.empty(count, 3, dtype=torch.float64),
        opacities=torch.empty(count, dtype=torch.float64),
        colors=Sh(torch.empty(count, (degree + 1) ** 2, 3), degree),
        quats=torch.empty(count, 4, dtype=torch.float64),
        scales=torch.empty(count, 3, dtype=torch.float64),
    )
    end = 0
    # Also while a part is read: files may hold any bits, and rows that are not finite are dropped.
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for part in parts:
            kept = _activated(_finite(part))
            first, end = end, end + len(kept)
            for name, tensor in kept.tensors().items():
                whole.tensors()[name][first:end] = tensor
    if end == 0:
        cause = "none of its rows is finite" if count else "it has no rows"
        raise DataError(f"{path} contains no splats: {cause}.", "Get the file again.")
    return (whole if end == count else whole.map(lambda tensor: tensor[:end])), count - end


def _finite(rows: StoredRows) -> StoredRows:
    """The rows whose activated values are all finite in float32."""
    finite = (np.abs(rows.means) <= MAX_COORDINATE).all(axis=1)
    finite &= (rows.log_scales <= MAX_LOG_SCALE).all(axis=1) & ~np.isnan(rows.logits)
    for values in (rows.quats, rows.dc, rows.rest):
        finite &= np.isfinite(values).reshape(len(rows), -1).all(axis=1)
    return rows if finite.all() else rows.take(finite)


def _activated(rows: StoredRows) -> Splats:
    coefficients = np.concatenate([rows.dc[:, None], rows.rest], axis=1)
    return Splats(
        means=torch.from_numpy(rows.means),
        # Other tools write infinite logits for opacities of 0 and 1, and scales of 0.
        opacities=torch.from_numpy(rows.logits).double().clamp(MIN_LOGIT, MAX_LOGIT).sigmoid(),
        colors=Sh(torch.from_numpy(coefficients), rows.degree),
        quats=unit_quaternions(torch.from_numpy(rows.quats).double()),
        scales=torch.from_numpy(rows.log_scales).double().clamp_min(MIN_LOG_SCALE).exp(),
    )
