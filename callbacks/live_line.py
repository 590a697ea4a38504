"""LiveLine: the figures of a running training in one line that fits any width."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rich.console import Console, ConsoleOptions
from rich.progress_bar import ProgressBar
from rich.segment import Segment
from rich.text import Text

from gsfw.core.words import brief, clock

LEAST_BAR, MOST_BAR = 8, 40
"""Columns of the bar; below the least there is none."""
GAP = "  "
SHORT_FROM = 100_000
"""Numbers of Gaussians from which a narrow line rounds them: 1.23M, 456k."""
MEMORY_NAMES = {"rss": "RAM", "cuda": "GPU"}


@dataclass
class Figures:
    """The figures in the line; changed in place as the run goes on."""

    step: int
    steps: int
    seconds_left: float | None = None
    loss: float = math.nan
    psnr: float = math.nan
    """Smoothed PSNR of training images, in dB."""
    held_out_psnr: float | None = None
    """PSNR of the latest evaluation, in dB."""
    gaussians: int = 0
    steps_per_second: float = 0.0
    resolution: float = 1.0
    """Width of training images over their full width."""
    skipped: int = 0
    memory_mb: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_small(self) -> bool:
        """True while training images are smaller than held-out ones."""
        return self.resolution < 1

    @property
    def size(self) -> str:
        """Width of training images over their full width: "1/2.8"."""
        return f"1/{1 / self.resolution:.2g}"

    def parts(self, is_short: bool) -> list[tuple[int, str]]:
        """The words of the line, left to right, each with its rank: high ones are left out first.

        Args:
            is_short: true to abbreviate.
        """
        left = "--:--" if self.seconds_left is None else clock(self.seconds_left)
        percent = f"{100 * self.step / max(self.steps, 1):3.0f}%"
        found = [(1, f"{self.step:>{len(str(self.steps))}}/{self.steps}"), (0, f"{left} left")]
        found = [(6, percent), *found] if not is_short else found
        if not math.isnan(self.psnr):
            found.append((3, f"PSNR {self.psnr:.1f} dB"))
            found.append((8, f"loss {self.loss:.4f}"))
            found.append((4, f"{_count(self.gaussians, is_short)} Gaussians"))
            found.append((7, f"{self.steps_per_second:.1f} steps/s"))
        # Held-out images have their full size: while training images are small, their figures
        # would read as if the model fitted training views alone.
        if self.held_out_psnr is not None and not self.is_small:
            found.insert(-3, (9, f"held out {self.held_out_psnr:.1f} dB"))
        if self.is_small:
            found.append((5, f"at {self.size} size"))
        if self.skipped:
            found.append((2, f"{self.skipped} skipped"))
        if self.memory_mb:
            found.append((1, memory(self.memory_mb)))
        return found


def memory(peaks_mb: Mapping[str, float]) -> str:
    """Peak memory in words: "RAM 0.4 GB  GPU 3.1 GB"."""
    return GAP.join(
        f"{MEMORY_NAMES.get(name, name)} {mb / 1e3:.1f} GB" for name, mb in peaks_mb.items()
    )


def _count(number: int, is_short: bool) -> str:
    if not is_short or number < SHORT_FROM:
        return f"{number:,}"
    return brief(number, 3)


def fitted(figures: Figures, width: int) -> str:
    """The most words that leave room for the bar, in their order.

    Args:
        figures: figures of the run.
        width: columns of the line.
    """
    room = width - LEAST_BAR - len(GAP)
    for is_short in (False, True):
        parts = figures.parts(is_short)
        if len(GAP.join(text for _, text in parts)) <= room:
            break
    while len(parts) > 1 and len(GAP.join(text for _, text in parts)) > room:
        worst = max(rank for rank, _ in parts)
        if worst <= 1:  # Steps, time and memory are worth more than the bar.
            room = width
            if len(GAP.join(text for _, text in parts)) <= room:
                break
        parts.remove(next(part for part in parts[::-1] if part[0] == worst))
    return GAP.join(text for _, text in parts)


class LiveLine:
    """A bar and the figures; draws the present state each time that the screen is refreshed."""

    def __init__(self, figures: Figures) -> None:
        self._figures = figures

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[Segment | Text]:
        """Draw one line, as wide as the screen."""
        width = options.max_width
        text = fitted(self._figures, width)
        room = min(width - len(text) - len(GAP), MOST_BAR)
        if room >= LEAST_BAR:
            bar = ProgressBar(self._figures.steps, self._figures.step, width=room)
            yield from (
                part
                for part in console.render(bar, options.update(width=room))
                if part.text != "\n"
            )
            yield Segment(GAP)
        yield Text(text, no_wrap=True, overflow="crop")
