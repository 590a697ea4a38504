"""Training memory: the peak of whole runs, measured, beside the estimate before them.

    python benchmarks/training_memory.py                  # all cases; half an hour
    python benchmarks/training_memory.py --only 3dgs      # those with a word in their settings

Measured is the largest anonymous memory (``RssAnon``, which control groups count) of a process
``gsfw train`` on the built-in scene with one thread. The table in docs/results/large-scenes.md has
its results, and the constants of core/training_memory.py are fitted to them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from printing import say

from gsfw.core.machine_memory import anonymous_memory
from gsfw.plugins.compose import compose
from gsfw.plugins.memory_fit import MemoryFit
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

FEW = 500
"""Points of a model that shows the bytes of a Gaussian."""


@dataclass(frozen=True)
class Case:
    """A run: its method, Gaussians, images and views of a step."""

    method: str
    gaussians: int
    width: int
    height: int
    views: int = 1
    settings: Sequence[str] = ()

    def words(self, gaussians: int) -> list[str]:
        """Settings of the case, with another number of Gaussians."""
        moving = ["datamanager.moving=true"] if self.method != "3dgs" else []
        return [
            *(f"method={self.method}", f"datamanager.points={gaussians}", "device=cpu", *moving),
            *(f"datamanager.width={self.width}", f"datamanager.height={self.height}"),
            *(f"sampler.views_per_step={self.views}", "datamanager.views=12", "steps=4"),
            *("datamanager.eval_views=2", "datamanager.times=2", "strategy.max_gaussians=0"),
            *self.settings,
        ]

    def __str__(self) -> str:
        size = f"{self.method}, {self.gaussians:,} at {self.width}x{self.height}"
        views = f", {self.views} views a step" if self.views > 1 else ""
        return ", ".join([size + views, *self.settings])


CASES = (
    *(Case("3dgs", number, 32, 24) for number in (1_000, 100_000, 300_000, 1_000_000)),
    Case("3dgs", 300_000, 32, 24, settings=("sh_degree=0",)),
    Case("3dgs", 300_000, 32, 24, settings=("sh_degree=1",)),
    *(Case("3dgs", 300_000, 160, 120, views) for views in (1, 4, 12)),
    *(Case("3dgs", 300_000, 320, 240, views) for views in (1, 4)),
    *(Case("3dgs", 20_000, 1600, 1200, views) for views in (1, 4)),
    *(Case("4dgs", number, 32, 24) for number in (100_000, 300_000)),
    Case("4dgs", 100_000, 160, 120, 4),
    *(Case("spacetime", number, 32, 24) for number in (100_000, 300_000)),
    Case("spacetime", 100_000, 160, 120, 4),
    Case("4d-rotor", 100_000, 32, 24),
    Case("dynamic3dgs", 100_000, 32, 24),
)


def measured(case: Case, out: Path) -> int:
    """Peak of the anonymous memory of a run, in bytes; 0 if it fails."""
    try:
        return peak_memory([*case.words(case.gaussians), f"out={out}"])
    except RuntimeError as error:
        say(str(error))
        return 0


def peak_memory(settings: list[str]) -> int:
    """Peak of the anonymous memory of ``gsfw train`` with these settings, in bytes.

    Raises:
        RuntimeError: the run fails.
    """
    peak = 0
    with subprocess.Popen(
        [sys.executable, "-m", "gsfw", "train", *settings],
        env=os.environ | {"OMP_NUM_THREADS": "1", "GSFW_STATE_DIR": "none"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        while run.poll() is None:
            peak = max(peak, anonymous_memory(Path(f"/proc/{run.pid}/status")))
            time.sleep(0.01)
        if run.returncode:
            raise RuntimeError(run.stderr.read() if run.stderr else "")
    return peak


def estimated(case: Case) -> float:
    """The estimate before the run, in bytes."""
    given = dict(word.split("=", 1) for word in case.words(FEW))
    composition = compose(resolve(installed(), [Layer(COMMAND_LINE, given)]), installed())
    parts = composition.parts
    fit = MemoryFit(composition.settings, parts.data, torch.device("cpu"))
    rows = case.gaussians * len(parts.table) // FEW
    need = fit.need(rows, fit.row(parts.model))
    return replace(need, points=case.gaussians).total


def main(arguments: list[str]) -> None:
    """Measure the cases, and print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="cases with these words alone")
    only = parser.parse_args(arguments).only
    say("| run | measured | estimate | ratio |\n|---|---|---|---|")
    for case in (case for case in CASES if only in str(case)):
        with tempfile.TemporaryDirectory() as folder:
            peak, estimate = measured(case, Path(folder) / "run"), estimated(case)
        ratio = estimate / peak if peak else 0.0
        say(f"| {case} | {peak / 1e6:.0f} MB | {estimate / 1e6:.0f} MB | {ratio:.2f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
