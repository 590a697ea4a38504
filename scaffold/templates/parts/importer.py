"""Importer my-part: splats from text, a line each.

The first line has the names of the columns: position and standard deviations in the units of the
data's world, rotation (quaternion, w first), opacity, and the colour, in [0, 1].
"""

from __future__ import annotations

import csv
from pathlib import Path

import torch
from gsfw.api import DataError, Importer, Sh, SplatFile, Splats, rgb_to_dc

COLUMNS = ("x", "y", "z", "sx", "sy", "sz", "qw", "qx", "qy", "qz", "opacity", "r", "g", "b")
"""Names of the columns."""


class MyPartImporter(Importer):
    """Reads comma-separated values."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True if the first line has the names of the columns."""
        head = ",".join(COLUMNS).encode()
        try:
            with path.open("rb") as file:
                return file.readline(len(head) + 2).strip() == head
        except OSError:
            return False

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: a line does not have the right numbers; names the line.
        """
        try:
            text = path.read_text("utf-8")
            lines = list(csv.reader(text.splitlines()))
        except (OSError, ValueError, csv.Error) as error:
            raise DataError(f"{path} cannot be read: {error}") from error
        if tuple(lines[0] if lines else ()) != COLUMNS:
            raise DataError(f"{path}: the first line is not {','.join(COLUMNS)}.")
        if not text.endswith("\n"):
            raise DataError(f"{path} ends in the middle of a line.", "Copy the file again.")
        rows = [_numbers(path, number, line) for number, line in enumerate(lines[1:], 2)]
        table = torch.tensor(rows, dtype=torch.float64).view(-1, len(COLUMNS))
        means, scales, quats, opacities, rgb = table.split([3, 3, 4, 1, 3], dim=1)
        colors = Sh(rgb_to_dc(rgb)[:, None], 0)
        return SplatFile(Splats(means, opacities[:, 0], colors, quats, scales))


def _numbers(path: Path, number: int, line: list[str]) -> list[float]:
    """The values of a line.

    Raises:
        DataError: they are not those of a splat.
    """
    try:
        values = [float(text) for text in line]
    except ValueError:
        values = []
    sane = len(values) == len(COLUMNS) and bool(torch.tensor(values).isfinite().all())
    if not sane or min(values[3:6]) < 0 or not any(values[6:10]) or not 0 <= values[10] <= 1:
        raise DataError(
            f"{path}, line {number}: {','.join(line)[:80]!r} is no splat.",
            "Expected 14 finite numbers: deviations from 0, a rotation, an opacity from 0 to 1.",
        )
    return values
