"""How long training steps of finished runs take, in turns.

    OMP_NUM_THREADS=1 python benchmarks/steps_of_runs.py ROUNDS RUN RUN ...

goes on from the last checkpoint of each run, in memory only: in each round every run takes the same
number of steps, which are beyond its schedules, so that no Gaussian comes or goes. Prints the
median over rounds of CPU time and wall-clock time per step, and the median of the ratios of CPU
time to the first run's in the same round, with quartiles.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore

STEPS = 5
"""Of each run in a round."""


def trainer_of(run: Path) -> Trainer:
    """The run as its last checkpoint left it, ready to go on."""
    restored = restore(RunFolder(run), installed())
    trainer = restored.composition.trainer(restored.folder, [], restored.step)
    trainer.load_state_dict(restored.state)
    return trainer


def times(trainers: list[Trainer], rounds: int) -> np.ndarray:
    """CPU and wall-clock milliseconds per step [rounds, trainers, 2], after a round to warm up."""
    found = np.zeros((rounds + 1, len(trainers), 2))
    for number in range(rounds + 1):
        for place, trainer in enumerate(trainers):
            before = time.process_time(), time.perf_counter()
            for _ in range(STEPS):
                trainer._one_step()
            after = time.process_time(), time.perf_counter()
            found[number, place] = (np.array(after) - before) * 1e3 / STEPS
    return found[1:]


def table(runs: list[Path], rounds: int) -> str:
    """The table."""
    trainers = [trainer_of(run) for run in runs]
    found = times(trainers, rounds)
    ratios = found[:, :, 0] / found[:, :1, 0]
    text = "| run | Gaussians | CPU ms | wall ms | CPU time, of the first | quartiles |\n"
    text += "| --- | ---: | ---: | ---: | ---: | ---: |\n"
    for place, (run, trainer) in enumerate(zip(runs, trainers, strict=True)):
        cpu, wall = np.median(found[:, place], axis=0)
        low, middle, high = np.quantile(ratios[:, place], [0.25, 0.5, 0.75])
        text += (
            f"| {run.name} | {len(trainer.parts.table):,} | {cpu:.1f} | {wall:.1f} | {middle:.3f} "
            f"| {low:.3f} to {high:.3f} |\n"
        )
    return text


if __name__ == "__main__":
    sys.stdout.write(table([Path(name) for name in sys.argv[2:]], int(sys.argv[1])))
