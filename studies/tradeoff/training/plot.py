"""Plot of trained variants: PSNR over size, render time and training time, with the fronts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.charts.fronts import CostDot, FrontPanel, front_figure
from gsfw.charts.style import BLACK, SERIES, write_figure
from gsfw.studies.tradeoff.training.axes import AXES, BASELINE
from gsfw.studies.tradeoff.training.report import yardstick
from gsfw.studies.tradeoff.training.trained import Trained, unbeaten

LABELS = {"MB": "size (MB)", "ms": "render time (ms per view)", "training": "training time (s)"}
"""Label of each cost."""

TOGETHER = "together"
"""Group of the variants that change several settings."""

COLOR = {BASELINE: BLACK, TOGETHER: SERIES[8]} | {
    axis.name: color for axis, color in zip(AXES, SERIES[:8], strict=False)
}


def write_plot(path: Path, found: Sequence[Trained]) -> None:
    """Plot a plane for each cost that is known.

    Raises:
        OutputError: the file cannot be written.
    """
    first = yardstick(found)
    ordered = sorted(found, key=lambda item: item != first)
    panels = []
    for cost, label in LABELS.items():
        dots = [_dot(item, price, cost) for item in ordered if (price := item.cost(cost))]
        if dots:
            front = [point.name for point in unbeaten(found, cost)]
            panels.append(FrontPanel(label, dots, front))
    present = {_group(item) for item in found}
    legend = {name: color for name, color in COLOR.items() if name in present}
    write_figure(path, front_figure(panels, legend))


def _dot(item: Trained, price: float, cost: str) -> CostDot:
    spread = item.draw_spread_ms if cost == "ms" else 0.0
    return CostDot(item.name, item.name, COLOR[_group(item)], price, item.psnr, spread)


def _group(item: Trained) -> str:
    if item.is_baseline:
        return BASELINE
    return item.axes[0] if len(item.axes) == 1 else TOGETHER
