"""Faults: stragglers and failures of machines, simulated, with the formulas beside them.

The interval of checkpoints is that of Daly 2006 ("A higher order estimate of the optimum checkpoint
interval for restart dumps").
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def daly_interval(checkpoint: float, between_failures: float) -> float:
    """Seconds of work between checkpoints, by Daly's estimate of higher order.

    Args:
        checkpoint: seconds to write one.
        between_failures: mean seconds between failures of any machine of a job.
    """
    if checkpoint >= 2 * between_failures:
        return between_failures
    ratio = checkpoint / (2 * between_failures)
    root = math.sqrt(2 * checkpoint * between_failures)
    return root * (1 + math.sqrt(ratio) / 3 + ratio / 9) - checkpoint


def time_with_failures(
    work: float, interval: float, checkpoint: float, restart: float, between_failures: float
) -> float:
    """Expected seconds of a job, with exponential times between failures (Daly's whole model).

    All arguments are in seconds; infinite where no interval is likely to be finished.
    """
    span = (interval + checkpoint) / between_failures
    if span > 500:
        return math.inf
    each = between_failures * math.exp(restart / between_failures) * math.expm1(span)
    return each * work / interval


def simulated_time(
    work: float,
    interval: float,
    checkpoint: float,
    restart: float,
    between_failures: float,
    generator: np.random.Generator,
) -> float:
    """Seconds of one job, event by event: work, checkpoints, failures and restarts.

    What was done since the last checkpoint is lost; a restart can fail too.
    """
    clock, done = 0.0, 0.0
    failure = generator.exponential(between_failures)
    while done < work:
        piece = min(interval, work - done)
        end = clock + piece + checkpoint
        if end <= failure:
            clock, done = end, done + piece
            continue
        clock = failure
        failure = clock + generator.exponential(between_failures)
        while clock + restart > failure:
            clock = failure
            failure = clock + generator.exponential(between_failures)
        clock += restart
    return clock


def straggling(
    steps: Sequence[float], size: int, generator: np.random.Generator, draws: int = 2000
) -> float:
    """Factor of a step's time when all processes wait for the slowest.

    The mean over draws of the maximum of ``size`` measured times, over the mean of them. It can
    never exceed the largest that was measured.

    Args:
        steps: measured times of steps of one process.
        size: processes, each of which draws its time independently.
        generator: random numbers.
        draws: simulated steps.
    """
    times = np.sort(np.asarray(steps, dtype=float))
    # The largest of N draws has rank ceil(len * u^(1/N)).
    ranks = np.ceil(len(times) * generator.random(draws) ** (1 / size)).astype(int)
    return float(times[np.clip(ranks, 1, len(times)) - 1].mean() / times.mean())
