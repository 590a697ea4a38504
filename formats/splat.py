"""The .splat of antimatter15's viewer: 32 bytes a splat, no header, no SH.

https://github.com/antimatter15/splat: position and scales as float32, colour and opacity as 8 bits,
the rotation as 8 bits for each of wxyz. The splats that matter most stand first, so that a page can
draw a file that it has in part.

What is read differs from what was written by at most 1 / 510 for colours in [0, 1] and opacities,
and by 1 / 256 for each component of a rotation before it is normalised; positions and scales are
those of float32.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32, Int, Shaped, UInt8
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.exchange import Exporter, ExportSource, Importer, SplatFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.files.ply_file import is_ply
from gsfw.core.files.reading import readable
from gsfw.core.splats import Splats
from gsfw.formats.activation import dc_of, logits_of, to_bytes
from gsfw.formats.stored_rows import (
    MIN_LOG_SCALE,
    StoredRows,
    gathered,
    stored_parts,
)

RECORD = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("quat", "u1", 4)])
ROWS = 1 << 16
"""Rows of a part when reading."""
SOUND = 0.5
"""Least part of the first rows that have finite positions and scales; of random bytes, 1/8 have."""


class SplatExporter(Exporter):
    """Writes the splats by descending volume times opacity."""

    suffix = ".splat"
    most_sh_degree = 0

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically; SH of degree 1 and above is omitted.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or out of range; names the field and the row.
        """
        splats = source.splat_file().splats
        with atomic_file(path) as file:
            for part in stored_parts(splats, _by_importance(splats)):
                file.write(_records(part).tobytes())


def _by_importance(splats: Splats) -> Int[Tensor, " n"] | None:
    """The rows by descending volume times opacity."""
    if splats.scales is None:
        return None  # Other forms are refused where the values are stored.
    return torch.argsort(splats.scales.prod(dim=1) * splats.opacities, descending=True, stable=True)


def _records(part: StoredRows) -> Shaped[np.ndarray, " n"]:
    records = np.empty(len(part), RECORD)
    records["mean"] = part.means
    records["scale"] = np.exp(part.log_scales.astype(np.float64))
    records["rgba"] = to_bytes(255 * np.column_stack([part.rgb, part.opacities]))
    # With the largest component negative: a byte holds -1, and 1 is beyond the largest, 127 / 128.
    largest = np.take_along_axis(part.quats, np.abs(part.quats).argmax(axis=1)[:, None], axis=1)
    records["quat"] = to_bytes(128 * np.where(largest > 0, -part.quats, part.quats) + 128)
    return records


class SplatImporter(Importer):
    """Reads files by their suffix: nothing else marks them."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for files named so, unless they are PLY, so that damage has its own reason."""
        return path.suffix.lower() == SplatExporter.suffix and path.is_file() and not is_ply(path)

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: its size is wrong, or its rows are no splats.
        """
        with readable(path):
            size = path.stat().st_size
        count, over = divmod(size, RECORD.itemsize)
        if over or not count:
            raise DataError(
                f"{path} is no complete .splat: it has {size} bytes, and each splat takes "
                f"{RECORD.itemsize}.",
                "It may have been cut short, or be of another format; get it again.",
            )
        splats, dropped = gathered(path, count, 0, _parts(path, count))
        return SplatFile(splats, properties={"encoding": "binary"}, num_dropped=dropped)


def _parts(path: Path, count: int) -> Iterator[StoredRows]:
    with path.open("rb") as file:
        for first in range(0, count, ROWS):
            part = _stored(np.fromfile(file, RECORD, ROWS))
            if first == 0:
                _check_plausible(path, part)
            yield part


def _stored(records: Shaped[np.ndarray, " n"]) -> StoredRows:
    """The stored values of some records; those with negative scales are not finite."""
    log_scales = np.log(records["scale"].astype(np.float64)).clip(min=MIN_LOG_SCALE)
    rgba = records["rgba"] / 255
    return StoredRows(
        means=records["mean"].astype(np.float64),
        logits=logits_of(rgba[:, 3]),
        log_scales=log_scales.astype(np.float32),
        quats=_quaternions(records["quat"]),
        dc=dc_of(rgba[:, :3]),
        rest=np.empty((len(records), 0, 3), dtype=np.float32),
    )


def _quaternions(stored: UInt8[np.ndarray, "n 4"]) -> Float32[np.ndarray, "n 4"]:
    """The quaternions, not normalised."""
    return (stored.astype(np.float32) - 128) / 128


def _check_plausible(path: Path, rows: StoredRows) -> None:
    """Refuse a file of other content."""
    sound = np.isfinite(rows.means).all(axis=1) & np.isfinite(rows.log_scales).all(axis=1)
    if sound.mean() < SOUND:
        raise DataError(
            f"{path} contains no splats: {1 - sound.mean():.0%} of its first rows have positions "
            "that are not finite, or negative scales.",
            "It may be of another format, which its suffix does not tell.",
        )
