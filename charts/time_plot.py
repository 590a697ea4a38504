"""Time plot: image quality at each time of an evaluation."""

from __future__ import annotations

from pathlib import Path

from gsfw.charts.lines import Line, LinePanel, line_figure
from gsfw.charts.style import SERIES, write_figure
from gsfw.core.loop.evaluation import Evaluation

SIZE = (960.0, 440.0)
"""Width and height of the axes with their margins, in layout units."""
METRICS = (("psnr", "PSNR of all pixels"), ("moving_psnr", "PSNR of moving pixels"))
"""Metric and its name in the legend."""


def write_time_plot(document: Path, evaluation: Evaluation) -> Path | None:
    """Plot PSNR over time as a PNG.

    Args:
        document: the result file; the plot is written beside it as NAME_over_time.png.
        evaluation: with metrics over time.

    Returns:
        The path of the plot; ``None`` if no metric has two times.

    Raises:
        OutputError: the file cannot be written.
    """
    lines = []
    for (key, name), color in zip(METRICS, SERIES, strict=False):
        points = tuple(
            (float(point["data_time"]), float(point[key]))
            for point in evaluation.over_time
            if key in point
        )
        if len(points) > 1:
            mean = sum(value for _, value in points) / len(points)
            label = f"{name}, mean over times {mean:.2f} dB"
            lines.append(Line(label, points, color=color))
    if not lines:
        return None
    panel = LinePanel("", "time, in the data's unit", tuple(lines), upward="PSNR (dB)")
    path = document.with_name(f"{document.stem}_over_time.png")
    write_figure(path, line_figure([panel], SIZE))
    return path
