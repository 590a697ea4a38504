"""ParetoPlot: PSNR of a finished model's variants against size and against time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.studies.dot_plot import COLORS
from gsfw.studies.tradeoff.front import size_front, time_front
from gsfw.studies.tradeoff.panel_plot import Dot, Panel, write_panel_plot
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import AS_IS, AXES, STORAGE

BLACK = (20, 20, 22)
FURTHER = ((222, 72, 140), (128, 172, 44))
"""Colours of axes beyond those that all plots have."""
COLOR = {AS_IS: BLACK} | dict(zip(AXES, (*COLORS, *FURTHER), strict=True))


def write_pareto_plot(path: Path, records: Sequence[Record]) -> None:
    """Draw both planes, and the fronts in them.

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
    panels = [Panel("MB", _first_first(stored), size_front(drawn))]
    if timed:
        panels.append(Panel("ms for a view", _first_first(timed), time_front(drawn)))
    present = {record.axis for record in drawn}
    write_panel_plot(path, panels, {axis: COLOR[axis] for axis in COLOR if axis in present})


def _dot(record: Record, cost: float, spread: float = 0.0) -> Dot:
    label = f"{record.axis} {record.name}"
    if record.axis in (AS_IS, "combined", "cutoffs", "prune", "time"):
        label = record.name
    psnr = record.psnr or 0.0
    return Dot(f"{record.axis}: {record.name}", label, COLOR[record.axis], cost, psnr, spread)


def _first_first(dots: Sequence[Dot]) -> list[Dot]:
    """The same, with the model as it is ahead."""
    return sorted(dots, key=lambda dot: dot.name != f"{AS_IS}: {AS_IS}")
