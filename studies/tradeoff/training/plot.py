"""Plot: PSNR of variants that were trained against size, drawing time and training time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.studies.dot_plot import COLORS
from gsfw.studies.tradeoff.panel_plot import Color, Dot, Panel, write_panel_plot
from gsfw.studies.tradeoff.training.axes import AXES, BASELINE
from gsfw.studies.tradeoff.training.report import yardstick
from gsfw.studies.tradeoff.training.trained import Trained, unbeaten

UNITS = {"MB": "MB", "ms": "ms for a view", "training": "seconds of training"}
"""What stands below each plane, by cost."""

TOGETHER = "together"
"""What the legend calls several choices."""

COLOR = {BASELINE: (20, 20, 22), TOGETHER: (222, 72, 140)} | {
    axis.name: color for axis, color in zip(AXES, COLORS, strict=False)
}


def write_plot(path: Path, found: Sequence[Trained]) -> None:
    """Draw a plane for each cost that is known, and the front in it.

    Raises:
        OutputError: the file cannot be written.
    """
    first = yardstick(found)
    ordered = sorted(found, key=lambda item: item != first)
    panels = []
    for cost, unit in UNITS.items():
        dots = [_dot(item, price, cost) for item in ordered if (price := item.cost(cost))]
        if dots:
            panels.append(Panel(unit, dots, unbeaten(found, cost)))
    present = {_group(item) for item in found}
    write_panel_plot(path, panels, {name: COLOR[name] for name in COLOR if name in present})


def _dot(item: Trained, price: float, cost: str) -> Dot:
    spread = item.draw_spread_ms if cost == "ms" else 0.0
    return Dot(item.name, item.name, _color(item), price, item.psnr, spread)


def _group(item: Trained) -> str:
    if item.is_baseline:
        return BASELINE
    return item.axes[0] if len(item.axes) == 1 else TOGETHER


def _color(item: Trained) -> Color:
    return COLOR[_group(item)]
