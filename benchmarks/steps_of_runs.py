"""Times of training steps and of rendered views of finished runs, in turns.

    OMP_NUM_THREADS=1 python benchmarks/steps_of_runs.py ROUNDS RUN RUN ...

goes on from the last checkpoint of each run, in memory only: in each round every run takes the same
number of steps, which are beyond its schedules, so that no Gaussian comes or goes, and renders the
same held-out views. Prints the median over rounds of CPU time and wall-clock time per step, and the
median of the ratios of CPU time to the first run's in the same round, with quartiles; and the same
of a view.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore

STEPS = 5
"""Steps and views of each run in a round."""


def trainer_of(run: Path) -> Trainer:
    """The run as its last checkpoint left it, ready to go on."""
    restored = restore(RunFolder(run), installed())
    trainer = restored.composition.trainer(restored.folder, [], restored.step)
    trainer.load_state_dict(restored.state)
    return trainer


def renderer_of(trainer: Trainer) -> Callable[[], None]:
    """Renders one held-out view after another, including the model's splats at its time."""
    parts, settings, device = trainer.parts, trainer.plan.settings, torch.device("cpu")
    count = len(parts.data.views(Split.EVAL))
    if count == 0:
        raise SystemExit(f"{trainer.folder.path} holds out no views: train it with some.")
    batches = [parts.data.load(Split.EVAL, [i % count], device)[0] for i in range(STEPS)]
    turns = cycle(batches)

    def render() -> None:
        batch = next(turns)
        render_model(parts.model, parts.rasterizer, batch.cameras, settings, batch.time)

    return render


def times(works: list[Callable[[], Any]], rounds: int) -> np.ndarray:
    """CPU and wall-clock milliseconds of each work [rounds, works, 2], after a round to warm up."""
    found = np.zeros((rounds + 1, len(works), 2))
    for number in range(rounds + 1):
        for place, work in enumerate(works):
            before = time.process_time(), time.perf_counter()
            for _ in range(STEPS):
                work()
            after = time.process_time(), time.perf_counter()
            found[number, place] = (np.array(after) - before) * 1e3 / STEPS
    return found[1:]


def table(runs: list[Path], rounds: int) -> str:
    """The table."""
    trainers = [trainer_of(run) for run in runs]
    works = {
        "step": [trainer._one_step for trainer in trainers],
        "view": [renderer_of(trainer) for trainer in trainers],
    }
    text = "| run | Gaussians | of | CPU ms | wall ms | CPU time, of the first | quartiles |\n"
    text += "| --- | ---: | --- | ---: | ---: | ---: | ---: |\n"
    for name, work in works.items():
        found = times(work, rounds)
        ratios = found[:, :, 0] / found[:, :1, 0]
        for place, (run, trainer) in enumerate(zip(runs, trainers, strict=True)):
            cpu, wall = np.median(found[:, place], axis=0)
            low, middle, high = np.quantile(ratios[:, place], [0.25, 0.5, 0.75])
            text += (
                f"| {run.name} | {len(trainer.parts.table):,} | {name} | {cpu:.1f} | {wall:.1f} "
                f"| {middle:.3f} | {low:.3f} to {high:.3f} |\n"
            )
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rounds", type=int)
    parser.add_argument("runs", nargs="+", type=Path)
    given = parser.parse_args()
    sys.stdout.write(table(given.runs, given.rounds))
