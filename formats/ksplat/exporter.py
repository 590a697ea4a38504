"""KsplatExporter: writes KSPLAT of level 0 or 1, one section."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource
from gsfw.core.files.atomic import atomic_file
from gsfw.core.splats import Splats
from gsfw.formats.activation import to_bytes
from gsfw.formats.ksplat.buckets import BUCKET, NONE, Buckets, buckets_of
from gsfw.formats.ksplat.layout import (
    CENTER_BYTES,
    MAIN,
    MAIN_BYTES,
    RANGE,
    SH_RANGE,
    VERSION,
    Section,
    record_type,
)
from gsfw.formats.stored_rows import StoredRows, check_any, stored_parts

MOST_DEGREE = 2
"""The original viewer reads no more."""
BLOCK = 5.0
"""Side of a block, as in the original; smaller for small splats."""
STEPS_OF_A_SPLAT = 8
"""Position steps in the median scale, at least."""
MOST_HALF = 65504
"""Largest float16."""


@dataclass(frozen=True)
class KsplatExporter(Exporter):
    """Writes splats for GaussianSplats3D, an older viewer: SH to degree 2."""

    suffix = ".ksplat"
    most_sh_degree = MOST_DEGREE

    level: Literal[0, 1] = 1
    """Level of compression: 0 (float32) or 1 (positions in 16 bits, the rest in float16)."""

    def __post_init__(self) -> None:
        """Check the level.

        Raises:
            ConfigError: it is not written.
        """
        if self.level not in (0, 1):
            raise ConfigError(
                f"format.level={self.level}: KSPLAT is written in level 0 or 1.",
                "Leave it out for 1. For smaller files: format=spz or format=sog.",
            )

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; SH bands above degree 2 are left out.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        splats = source.splat_file().splats.up_to(MOST_DEGREE)
        check_any(splats)
        block = _block(splats)
        buckets = _buckets(splats, block) if self.level else NONE
        section = Section(
            count=len(splats),
            room=len(splats),
            bucket_size=BUCKET * self.level,
            buckets=len(buckets.lengths),
            block=block * self.level,
            center_bytes=CENTER_BYTES * self.level,
            steps=RANGE * self.level,
            full=buckets.full,
            partial=len(buckets.lengths) - buckets.full,
            degree=splats.sh_degree,
        )
        with atomic_file(path) as file:
            file.write(_main_header(len(splats), self.level))
            file.write(section.to_bytes(self.level))
            file.write(buckets.lengths[buckets.full :].astype("<u4").tobytes())
            file.write(buckets.centers.tobytes())
            first = 0
            for part in stored_parts(splats, buckets.order):
                records = _records(part, self.level)
                if self.level:
                    _set_steps(records, part.means, _centers(buckets, first, len(part)), block)
                file.write(records.tobytes())
                first += len(part)


def _main_header(count: int, level: int) -> bytes:
    header = MAIN.pack(*VERSION, 1, 1, count, count, level, 0, 0, 0, -SH_RANGE, SH_RANGE)
    return header.ljust(MAIN_BYTES, b"\0")


def _block(splats: Splats) -> float:
    """Side of the blocks: small enough that position steps are finer than the splats."""
    size = float(splats.scales.median()) if splats.scales is not None else 0.0
    if not size > 0 or not math.isfinite(size):
        return BLOCK
    return float(np.float32(min(BLOCK, size / STEPS_OF_A_SPLAT * 2 * RANGE)))


def _buckets(splats: Splats, block: float) -> Buckets:
    """The buckets; a row that float32 does not hold is in one of them, and refused later."""
    held = splats.means.float().isfinite()
    return buckets_of(splats.means.where(held, 0.0), block)


def _centers(buckets: Buckets, first: int, count: int) -> Float64[np.ndarray, "n 3"]:
    """The centres of the buckets of some rows in the order of the file."""
    ends = buckets.lengths.cumsum()
    places = np.searchsorted(ends, np.arange(first, first + count), side="right")
    return buckets.centers[places].astype(np.float64)


def _records(rows: StoredRows, level: int) -> np.ndarray:
    """The records of some splats; positions of level 1 are not in them yet."""
    records = np.zeros(len(rows), dtype=record_type(level, rows.degree))
    scales = np.exp(rows.log_scales)
    if level:
        _check_scales(scales)
    else:
        records["position"] = rows.means
    records["scale"] = scales
    records["quat"] = rows.quats
    records["rgba"][:, :3] = to_bytes(rows.rgb * 255)
    records["rgba"][:, 3] = to_bytes(rows.opacities * 255)
    for band in range(1, rows.degree + 1):
        columns = slice(band * band - 1, (band + 1) ** 2 - 1)
        values = rows.rest[:, columns].transpose(0, 2, 1).reshape(len(rows), -1)
        if level:  # Colours as extreme as the ends of float16 look the same beyond them.
            values = values.clip(-MOST_HALF, MOST_HALF)
        records["sh"][:, 3 * columns.start : 3 * columns.stop] = values
    return records


def _check_scales(scales: np.ndarray) -> None:
    """Refuse scales that float16 does not hold."""
    if scales.size and scales.max() > MOST_HALF:
        raise ValueError(
            f"scales: the largest is {scales.max():g}, and float16 ends at {MOST_HALF}; "
            "format.level=0 holds it"
        )


def _set_steps(
    records: np.ndarray, means: np.ndarray, centers: Float64[np.ndarray, "n 3"], block: float
) -> None:
    """Fill in positions relative to the centres of the buckets."""
    steps = np.rint((means - centers) * (2 * RANGE / block)) + RANGE
    records["position"] = np.clip(steps, 0, 2 * RANGE + 1)
