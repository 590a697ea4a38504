"""Plot of a finished model's variants: PSNR over size and over render time, with both fronts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.charts.fronts import CostDot, FrontPanel, front_figure
from gsfw.charts.style import BLACK, SERIES, write_figure
from gsfw.studies.tradeoff.front import Point, size_front, time_front
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import AS_IS, AXES, STORAGE

COLOR = {AS_IS: BLACK} | dict(zip(AXES, SERIES, strict=True))


def write_pareto_plot(path: Path, records: Sequence[Record]) -> None:
    """Plot both planes of cost and quality.

    Raises:
        OutputError: the file cannot be written.
    """
    drawn = [record for record in records if record.psnr is not None]
    stored = [_dot(record, record.size / 1e6) for record in drawn if record.axis in STORAGE]
    timed = [
        _dot(record, record.ms, record.ms_spread or 0.0)
        for record in drawn
        if record.ms is not None
    ]
    panels = [_panel("size (MB)", stored, size_front(drawn))]
    if timed:
        panels.append(_panel("render time (ms per view)", timed, time_front(drawn)))
    present = {record.axis for record in drawn}
    legend = {axis: color for axis, color in COLOR.items() if axis in present}
    write_figure(path, front_figure(panels, legend))


def _panel(cost: str, dots: Sequence[CostDot], front: Sequence[Point]) -> FrontPanel:
    """A plane whose first dot is the model as it is."""
    ordered = sorted(dots, key=lambda dot: dot.name != f"{AS_IS}: {AS_IS}")
    return FrontPanel(cost, ordered, [point.name for point in front])


def _dot(record: Record, cost: float, spread: float = 0.0) -> CostDot:
    label = f"{record.axis} {record.name}"
    if record.axis in (AS_IS, "combined", "cutoffs", "prune", "time"):
        label = record.name
    color, psnr = COLOR[record.axis], record.psnr or 0.0
    return CostDot(f"{record.axis}: {record.name}", label, color, cost, psnr, spread)
