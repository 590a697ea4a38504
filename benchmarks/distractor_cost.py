"""Time of steps that leave distractors out, against those of the same run that use whole images.

    python benchmarks/distractor_cost.py [NAME=VALUE ...] [--sizes 320x180 640x359] [--repeats 3]

Prints the rows of the table in docs/results/corrections.md. Both kinds of steps alternate in each
run, and sizes alternate between runs; a figure is the median over the steps of all runs.
"""

# ruff: noqa: T201
from __future__ import annotations

import argparse
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from gsfw.commands.interface.arguments import Arguments, layers
from gsfw.core.callback import Callback, Control
from gsfw.core.loop.distractors import Distractors
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import resolve

WARM_UP = 60
"""Steps of a run before the first that is measured."""
SETTINGS = (
    *("method=3dgs", "device=cpu", "strategy=none", "datamanager.views=60", "eval_every=0"),
    *("steps=400", f"log_every={10**6}", "ignore_distractors=true", "distractors_start=20"),
)


class StepTimes(Callback):
    """Wall-clock times of steps in milliseconds, of those that leave distractors out and others."""

    def __init__(self, finder: Distractors, times: dict[bool, list[float]]) -> None:
        self._finder, self._times = finder, times
        self._last = 0.0

    def on_tick(self, step: int, control: Control) -> None:
        """Add the time of a step."""
        now = time.perf_counter()
        if step > WARM_UP:
            self._times[self._finder.are_left_out(step - 1)].append(1e3 * (now - self._last))
        self._last = now


def measure(size: str, settings: list[str], times: dict[bool, list[float]]) -> None:
    """Add the times of one run."""
    width, height = size.split("x")
    given = (*SETTINGS, f"datamanager.width={width}", f"datamanager.height={height}", *settings)
    words = dict(word.split("=", 1) for word in given)
    run = compose(resolve(installed(), layers(Arguments((), tuple(words.items())))), installed())
    assert run.parts.distractors is not None
    with TemporaryDirectory() as folder:
        watch = StepTimes(run.parts.distractors, times)
        run.trainer(RunFolder(Path(folder) / "run"), [watch]).fit()


def main() -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", nargs="+", default=["320x180", "640x359"])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("settings", nargs="*", help="of the runs")
    given = parser.parse_args()
    times: dict[str, dict[bool, list[float]]] = {size: defaultdict(list) for size in given.sizes}
    for _ in range(given.repeats):
        for size in given.sizes:
            measure(size, given.settings, times[size])
    for size, found in times.items():
        whole, without = median(found[False]), median(found[True])
        print(f"| {size} | {whole:.1f} ms | {without:.1f} ms | {without / whole - 1:+.0%} |")


if __name__ == "__main__":
    main()
