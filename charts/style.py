"""House style of all charts: colours, type, resolution, and how a figure becomes a PNG.

matplotlib is imported when the first chart is drawn: importing this module stays cheap. Figures are
made without pyplot, so no global state is kept and no display is needed.
"""

from __future__ import annotations

import functools
import io
import logging
import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from jaxtyping import UInt8

from gsfw.core.files.atomic import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Color = str
"""#rrggbb, which Pillow understands too."""

INK: Color = "#3c3c40"
FAINT: Color = "#78787e"
FAINTER: Color = "#b0b0b6"
GRID: Color = "#e4e4e8"
PAPER: Color = "#ffffff"
BLACK: Color = "#141416"
SERIES: tuple[Color, ...] = (
    *("#1f5bab", "#d16224", "#2e8656", "#92489e", "#b22c3c", "#148a96", "#96761e", "#606068"),
    *("#de488c", "#80ac2c"),
)
"""Colours of series, in order; they repeat."""
BLUES: tuple[Color, ...] = ("#0c346e", "#1f5bab", "#548ed4", "#8eb8ea", "#c2daf6")
"""An ordered scale, from dark to light."""

UNITS = 100
"""Layout units per inch: sizes of charts are given in these units."""
DPI = 150
"""A layout unit is 1.5 pixels, so that text stays sharp on screens of high density."""

SMALL, NORMAL, LARGE = 8.0, 9.0, 11.0
"""Sizes of type, in points."""

SETTINGS: dict[str, Any] = {
    "agg.path.chunksize": 20_000,
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.facecolor": PAPER,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": NORMAL,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": INK,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.unicode_minus": False,
    "figure.dpi": DPI,
    "figure.facecolor": PAPER,
    "font.family": ["DejaVu Sans"],
    "font.size": NORMAL,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "legend.fontsize": NORMAL,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.labelcolor": INK,
    "lines.linewidth": 1.5,
    "lines.markersize": 4.0,
    "lines.solid_capstyle": "round",
    "savefig.dpi": DPI,
    "text.color": INK,
    # Names of scenes and rows are shown as they are, dollar signs included.
    "text.parse_math": False,
    "xtick.color": INK,
    "xtick.labelsize": SMALL,
    "xtick.major.pad": 6.0,
    "xtick.major.size": 0.0,
    "xtick.minor.size": 0.0,
    "ytick.color": INK,
    "ytick.labelsize": SMALL,
    "ytick.major.pad": 5.0,
    "ytick.major.size": 0.0,
    "ytick.minor.size": 0.0,
}
"""rcParams on top of matplotlib's own defaults; a matplotlibrc of the user has no effect."""

P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def _house_style() -> Iterator[None]:
    """Defaults of matplotlib with ``SETTINGS``; the previous rcParams return afterwards."""
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.ERROR)  # The first import may announce that it builds the font cache.
    try:
        import matplotlib as mpl

        with mpl.rc_context(), warnings.catch_warnings():
            # A name may have characters that DejaVu Sans lacks: they are shown as boxes.
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            mpl.rcdefaults()
            parameters: Any = mpl.rcParams  # Its types know the names of one version only.
            parameters.update(SETTINGS)
            yield
    finally:
        log.setLevel(level)


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Run a function in the house style: artists take their defaults when they are made."""

    @functools.wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> R:
        with _house_style():
            return function(*args, **kwargs)

    return inside


def new_figure(width: float, height: float) -> Figure:
    """An empty figure with an Agg canvas.

    Args:
        width: in layout units.
        height: in layout units.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / UNITS, height / UNITS), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def place(figure: Figure, left: float, top: float, right: float, bottom: float) -> Axes:
    """Axes whose four borders are given in layout units from the upper left corner."""
    width, height = figure.get_size_inches() * UNITS
    return figure.add_axes(
        (left / width, 1 - bottom / height, (right - left) / width, (bottom - top) / height)
    )


def write(
    figure: Figure,
    x: float,
    y: float,
    text: str,
    *,
    size: float = NORMAL,
    color: Color = INK,
    bold: bool = False,
    align: str = "left",
) -> None:
    """Write a line of text at a place in layout units from the upper left corner.

    Args:
        figure: to write on.
        x: of the end that ``align`` names.
        y: of the middle.
        text: the line.
        size: in points.
        color: of the text.
        bold: whether it is bold.
        align: "left", "center" or "right".
    """
    width, height = figure.get_size_inches() * UNITS
    figure.text(
        *(x / width, 1 - y / height, text),
        size=size,
        color=color,
        weight="bold" if bold else "normal",
        ha=align,
        va="center",
    )


def text_width(text: str, bold: bool = False) -> float:
    """Width of a line of text of normal size, in layout units."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():  # TextPath of matplotlib 3.11 fails on text without outlines.
        return 0.0
    font = FontProperties(size=NORMAL, weight="bold" if bold else "normal")
    return float(TextPath((0.0, 0.0), text, prop=font).get_extents().x1) * UNITS / 72


@styled
def png_bytes(figure: Figure) -> bytes:
    """A figure as a PNG; the same figure gives the same bytes, as no software or date is named."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


@styled
def pixels(figure: Figure) -> UInt8[np.ndarray, "h w 3"]:
    """A figure as sRGB pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3].copy()


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure as a PNG; folders are made as needed.

    Raises:
        OutputError: the file cannot be written.
    """
    write_atomically(path, png_bytes(figure))


def ratio_marks(low: float, high: float) -> list[float]:
    """Marks of a logarithmic axis at 1, 2 and 5 of every decade, just around [low, high]."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    marks = [float(f"{digit}e{decade}") for decade in decades for digit in (1, 2, 5)]
    first = max((mark for mark in marks if mark <= low), default=marks[0])
    last = min((mark for mark in marks if mark >= high), default=marks[-1])
    return [mark for mark in marks if first <= mark <= last]


def round_marks(low: float, high: float, count: int = 6) -> list[float]:
    """Equidistant round marks just around [low, high], with at most about ``count`` steps.

    The step is 1, 2 or 5 times a power of ten. Equal ends get an interval of length 1.
    """
    from matplotlib.ticker import MaxNLocator

    if high - low < 1e-9:
        low, high = low - 0.5, high + 0.5
    marks = MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(f"{mark:.12g}") for mark in marks]


def mark_axis(axes: Axes, which: str, marks: list[float], ratio: bool = False) -> None:
    """Ticks at marks, written briefly; the axis reaches from the first mark to the last."""
    from matplotlib.ticker import NullLocator

    axis, scale, limits = (
        (axes.xaxis, axes.set_xscale, axes.set_xlim)
        if which == "x"
        else (axes.yaxis, axes.set_yscale, axes.set_ylim)
    )
    scale("log" if ratio else "linear")
    axis.set_ticks(marks, [f"{mark:g}" for mark in marks])
    axis.set_minor_locator(NullLocator())
    if len(marks) > 1:
        limits(marks[0], marks[-1])
