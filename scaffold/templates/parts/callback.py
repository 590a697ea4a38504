"""Callback my-part: writes the losses of a run into losses.csv."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from gsfw.api import Callback, CallbackConfig, Control, RunInfo, StepReport, number


@dataclass
class MyPartConfig(CallbackConfig):
    """Settings of callback my-part."""

    every: int = number(1, at_least=1)
    """Logged steps between two lines; log_every= says which steps are logged."""

    def build(self) -> Callback:
        """Build the callback of one run."""
        return MyPart(self.every)


class MyPart(Callback):
    """Writes step, number of Gaussians, and each weighted term of the loss."""

    def __init__(self, every: int) -> None:
        self._every = every
        self._path = Path()
        self._reports = 0

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Start a file, or continue that of a resumed run."""
        self._path = run.folder / "losses.csv"
        if run.first_step == 0:
            self._path.unlink(missing_ok=True)

    def on_step(self, report: StepReport, control: Control) -> None:
        """Write a line; terms that appear later have no heading, and are left out."""
        self._reports += 1
        if (self._reports - 1) % self._every:
            return
        row = {"step": report.step, "gaussians": report.num_gaussians, **report.losses}
        is_new = not self._path.exists()
        names = list(row) if is_new else self._headings()
        with self._path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, names, extrasaction="ignore")
            if is_new:
                writer.writeheader()
            writer.writerow(row)

    def _headings(self) -> list[str]:
        with self._path.open(newline="", encoding="utf-8") as file:
            return next(csv.reader(file))
