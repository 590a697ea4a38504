"""Exporter my-part: splats as text, a line each.

The first line has the names of the columns: position and standard deviations in the units of the
data's world, rotation (unit quaternion, w first), opacity, and the mean colour, in [0, 1].
"""

from __future__ import annotations

from pathlib import Path

import torch
from gsfw.api import Exporter, ExportSource, Sh, SplatFile, dc_to_rgb, write_atomically
from torch.nn.functional import normalize

COLUMNS = ("x", "y", "z", "sx", "sy", "sz", "qw", "qx", "qy", "qz", "opacity", "r", "g", "b")
"""Names of the columns."""


class MyPartExporter(Exporter):
    """Writes comma-separated values; view-dependent colour is left out."""

    suffix = ".csv"
    most_sh_degree = 0

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite; names its column and row.
        """
        table = _table(source.splat_file())
        for row, column in (~table.isfinite()).nonzero().tolist():
            raise ValueError(f"{COLUMNS[column]} of splat {row} is {table[row, column]:g}")
        lines = [",".join(COLUMNS)]
        lines += [",".join(f"{value:.9g}" for value in row) for row in table.tolist()]
        write_atomically(path, "\n".join([*lines, ""]).encode())


def _table(content: SplatFile) -> torch.Tensor:
    """The values of all splats, [n, 14], float64."""
    splats = content.splats
    assert splats.quats is not None  # By the contract of SplatFile.
    assert splats.scales is not None
    colors = splats.colors
    rgb = dc_to_rgb(colors.coefficients[:, 0]) if isinstance(colors, Sh) else colors[:, :3]
    quats, opacities = normalize(splats.quats, dim=1), splats.opacities[:, None]
    columns = [splats.means, splats.scales, quats, opacities, rgb.clamp(0, 1)]
    return torch.cat([column.double() for column in columns], dim=1)
