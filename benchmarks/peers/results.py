"""Results: one line of JSON for each finished training, and what is drawn from them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from gsfw.charts.lines import Line, LinePanel, line_figure
from gsfw.charts.style import write_figure
from gsfw.studies.table import Table
from peers.held_out import Score
from peers.job import Job, Usage

PANEL = (560.0, 380.0)
"""Size of a plot, in layout units."""


@dataclass(frozen=True)
class Result:
    """A finished training."""

    peer: str
    length: str
    repeat: int
    cpu_seconds: float
    wall_seconds: float
    psnr: float
    ssim: float
    gaussians: int

    @staticmethod
    def of(job: Job, repeat: int, usage: Usage, score: Score) -> Result:
        """The result of a job."""
        return Result(job.peer, job.length, repeat, **asdict(usage), **asdict(score))


class Results:
    """The results in a file; an interrupted bench goes on where it stopped."""

    def __init__(self, file: Path) -> None:
        """Read what is there."""
        self._file = file
        lines = file.read_text().splitlines(keepends=True) if file.exists() else []
        whole = [line for line in lines if line.endswith("\n")]
        if whole != lines:  # A bench was killed while it wrote the last one.
            file.write_text("".join(whole))
        self.rows = [Result(**json.loads(line)) for line in whole]

    def has(self, job: Job, repeat: int) -> bool:
        """True if the job is done."""
        done = {(row.peer, row.length, row.repeat) for row in self.rows}
        return (job.peer, job.length, repeat) in done

    def add(self, result: Result) -> None:
        """Append a result to the file."""
        self.rows.append(result)
        with self._file.open("a") as file:
            file.write(json.dumps(asdict(result)) + "\n")

    def medians(self) -> list[Result]:
        """For each trainer and length the medians over repeats, in order of trainer and CPU time.

        ``repeat`` is the number of repeats.
        """
        groups: dict[tuple[str, str], list[Result]] = {}
        for row in self.rows:
            groups.setdefault((row.peer, row.length), []).append(row)
        middle = [_median(rows) for rows in groups.values()]
        order = list(dict.fromkeys(row.peer for row in self.rows))
        return sorted(middle, key=lambda row: (order.index(row.peer), row.cpu_seconds))

    def table(self) -> str:
        """A Markdown table of the medians."""
        headings = ("trainer", "length", "CPU s", "wall s", "Gaussians", "PSNR", "SSIM")
        rows = [
            (
                *(row.peer, row.length, f"{row.cpu_seconds:.1f}", f"{row.wall_seconds:.1f}"),
                *(f"{row.gaussians:,}", f"{row.psnr:.2f}", f"{row.ssim:.4f}"),
            )
            for row in self.medians()
        ]
        return Table(headings, rows).markdown()

    def times_to(self, levels: Sequence[float]) -> str:
        """A Markdown table of the CPU seconds of the first training that reaches each PSNR."""
        rows = []
        for peer in dict.fromkeys(row.peer for row in self.rows):
            runs = [row for row in self.medians() if row.peer == peer]
            cells = []
            for level in levels:
                reached = [row.cpu_seconds for row in runs if row.psnr >= level]
                cells.append(f"{min(reached):.1f}" if reached else "-")
            rows.append((peer, *cells))
        return Table(("trainer", *(f"{level:g} dB" for level in levels)), rows).markdown()

    def draw(self, file: Path, title: str) -> None:
        """Write the curves of PSNR over CPU time as a PNG.

        Args:
            file: is replaced.
            title: above the plot.
        """
        points: dict[str, list[tuple[float, float]]] = {}
        for row in self.medians():
            points.setdefault(row.peer, []).append((row.cpu_seconds, row.psnr))
        lines = tuple(Line(peer, tuple(curve)) for peer, curve in points.items())
        panel = LinePanel(title, "CPU seconds, all of the process", lines, "PSNR (dB)", ratio=True)
        write_figure(file, line_figure([panel], PANEL))


def _median(rows: Sequence[Result]) -> Result:
    first = rows[0]
    names = ("cpu_seconds", "wall_seconds", "psnr", "ssim")
    figures = {name: median(getattr(row, name) for row in rows) for name in names}
    gaussians = round(median(row.gaussians for row in rows))
    return Result(first.peer, first.length, len(rows), gaussians=gaussians, **figures)
