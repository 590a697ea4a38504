"""Heat map of a stress test: the errors of every backend and dtype over the planes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.charts.heat_map import HeatPanel, heat_figure
from gsfw.charts.style import write_figure
from gsfw.studies.stress.plane import EMPTY, PlaneErrors


def write_heat_map(path: Path, measured: Sequence[PlaneErrors]) -> None:
    """Plot a row for each backend and dtype: for each plane, errors of the image and of gradients.

    Raises:
        OutputError: the file cannot be written.
    """
    rows: dict[tuple[str, str], list[HeatPanel]] = {}
    for errors in measured:
        panels = rows.setdefault((errors.backend, errors.dtype), [])
        panels += [_panel(errors, "image"), _panel(errors, "gradient")]
    write_figure(path, heat_figure(list(rows.values())))


def _panel(errors: PlaneErrors, kind: str) -> HeatPanel:
    plane, table = errors.plane, errors.image if kind == "image" else errors.gradient
    return HeatPanel(
        f"{errors.backend}, {errors.dtype}: {kind}",
        plane.across,
        plane.upward,
        plane.across_values,
        plane.upward_values,
        [[None if error == EMPTY else error for error in row] for row in table],
    )
