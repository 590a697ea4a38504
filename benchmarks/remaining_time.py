"""Error of the predicted remaining time of recorded runs; nothing is trained.

    python benchmarks/remaining_time.py PART RUN RUN ...

replays metrics.jsonl of finished run folders to ``PART`` of their steps (0.25), and compares the
predicted time of the other steps with what they took: by the model of the progress line, and by
the rate of the last logged steps, which it replaced. Evaluations are not in that file. Prints a
line per run, and medians.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from gsfw.core.callback import RunInfo
from gsfw.core.loop.remaining_time import RemainingTime
from gsfw.core.loop.run_folder import RunFolder
from gsfw.methods.dynamic3d.config import TRACKING_COST
from gsfw.methods.gaussians4d.config import FIELD_COST
from gsfw.plugins.config_file import read_config

LEAST_LINES = 30
"""Logged steps of a run that is long enough to be judged."""


@dataclass(frozen=True)
class Judged:
    """Errors of two predictions, relative to the true time."""

    run: Path
    method: str
    steps: int
    model: float | None
    """``None`` where nothing was said yet."""
    rate: float


def run_info(folder: RunFolder) -> RunInfo:
    """The facts of a recorded run that its callbacks were told."""
    settings = dict(read_config(folder.config, everything=True).values)
    said = folder.log.read_text() if folder.log.exists() else ""
    views = re.search(r"(\d+) views to train on", said)
    costs = [(0, 1.0)]
    for key, cost in (("coarse_steps", FIELD_COST), ("sampler.first_steps", TRACKING_COST)):
        if settings.get(key):
            costs.append((int(settings[key]), cost))
    return RunInfo(
        folder=folder.path,
        method=str(settings["method"]),
        scene="",
        steps=int(settings["steps"]),
        first_step=0,
        settings=settings,
        protocol={},
        views=int(views[1]) if views else 0,
        step_costs=tuple(costs),
    )


def judge(run: Path, part: float) -> Judged | None:
    """Replay a run; ``None`` for one that is short, or was not finished."""
    folder = RunFolder(run)
    if not folder.metrics_log.exists() or not folder.config.exists():
        return None
    info = run_info(folder)
    documents = [json.loads(line) for line in folder.metrics_log.read_text().splitlines()]
    lines: list[dict[str, Any]] = [document for document in documents if "step_ms" in document]
    if len(lines) < LEAST_LINES or lines[-1]["step"] != info.steps:
        return None
    remaining, before, rest, rate = RemainingTime(info), 0, 0.0, 0.0
    every = int(info.settings.get("eval_every", 0) or 0)
    for line in lines:
        step, seconds = line["step"], line["step_ms"] / 1e3
        evaluated = (step - 1) // every * every if every else 0
        if step > part * info.steps:
            rest += seconds * (step - max(before, evaluated))
        else:
            if evaluated >= before and evaluated:
                remaining.evaluated(evaluated, 0.0, 0)
            remaining.observe(step, line["num_gaussians"], line["resolution"], seconds)
            rate = seconds * (info.steps - step)
        before = step
    predicted = remaining.seconds()
    error = None if predicted is None else predicted / rest - 1
    return Judged(run, info.method, info.steps, error, rate / rest - 1)


def report(found: list[Judged]) -> str:
    """A line per run, and the medians of the errors' sizes."""
    lines = []
    for item in found:
        model = "nothing" if item.model is None else f"{100 * item.model:+.0f} %"
        name = f"{item.run.parent.name}/{item.run.name}"
        lines.append(f"{name} ({item.method}, {item.steps} steps): {model}, {100 * item.rate:+.0f}")
    said = [abs(item.model) for item in found if item.model is not None]
    if said:
        lines.append(
            f"{len(said)} of {len(found)} runs; median error {100 * median(said):.0f} %, by the "
            f"rate {100 * median(abs(item.rate) for item in found):.0f} %"
        )
    if not found:
        lines.append(f"No run is finished and has {LEAST_LINES} logged steps. Name longer runs.")
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> None:
    """Judge the given runs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", type=float, metavar="PART")
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    given = parser.parse_args(arguments)
    judged = [judge(run, given.part) for run in given.runs]
    sys.stdout.write(report([item for item in judged if item is not None]))


if __name__ == "__main__":
    main(sys.argv[1:])
