"""Dot plot of a study: the accuracy of every row on every scene, with the spread over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.charts.dots import Dot, Group, dot_figure
from gsfw.charts.style import write_figure
from gsfw.studies.comparison import SceneTable, heading

MOST_PANELS = 3


def write_dot_plot(path: Path, tables: Sequence[SceneTable]) -> bool:
    """Plot the first metrics of accuracy, a panel for each.

    Returns:
        False if the tables have no metric of accuracy; no file is written then.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = list(dict.fromkeys(c for table in tables for c in table.columns if c.best))
    panels = {column.name: heading(column) for column in columns[:MOST_PANELS]}
    if not panels:
        return False
    groups = [
        Group(
            table.scene,
            {
                line.row: {key: Dot(one.mean, one.spread) for key, one in line.figures.items()}
                for line in table.lines
                if line.figures
            },
        )
        for table in tables
    ]
    write_figure(path, dot_figure(groups, panels))
    return True
