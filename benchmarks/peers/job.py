"""Job: one training of one trainer, as a command that leaves a PLY; and how it is timed."""

from __future__ import annotations

import os
import shlex
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Variables by which a trainer learns its number of threads."""
LOG = "log.txt"
Color = tuple[float, float, float]
"""Red, green, blue in [0, 1]."""
BLACK: Color = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Order:
    """The training that every trainer is asked for."""

    capture: Path
    """Training views with a COLMAP model, at the size of training."""
    folder: Path
    """Runs get folders of their own in it."""
    steps: tuple[int, ...]
    """Lengths of the trainings; each is a run of its own, as schedules depend on it."""


@dataclass(frozen=True)
class Job:
    """One training."""

    peer: str
    """Name of the trainer with its settings."""
    length: str
    """"1000 steps", or "1 min"."""
    folder: Path
    command: tuple[str, ...]
    splats: Path
    """The PLY that the command leaves."""
    background: Color = BLACK
    """Colour over which the trainer renders, wherever splats are not opaque."""


@dataclass(frozen=True)
class Usage:
    """Cost of a process, from its start to its end, including what it waited for."""

    cpu_seconds: float
    """User and system time of all threads."""
    wall_seconds: float


def run(job: Job, threads: int) -> Usage:
    """Run a job; its output goes to log.txt in its folder.

    Args:
        job: its folder is made.
        threads: number of threads of the trainer.

    Raises:
        SystemExit: the trainer failed, or left no PLY; names the log.
    """
    job.folder.mkdir(parents=True, exist_ok=True)
    log = job.folder / LOG
    environment = os.environ | dict.fromkeys(THREADS, str(threads))
    began = time.perf_counter()
    with log.open("w") as output:
        process = subprocess.Popen(
            job.command, stdout=output, stderr=subprocess.STDOUT, env=environment
        )
        # Unlike Popen.wait, this returns the usage of this one child.
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - began
    if process.returncode or not job.splats.is_file():
        ended = f"ended with {process.returncode}" if process.returncode else "left no PLY"
        raise SystemExit(
            f"{job.peer}, {job.length}: {ended}; its last words are in {log}.\n"
            f"Run it alone with: {shlex.join(job.command)}"
        )
    # Its ru_maxrss would be of no use: it counts this process as well, from before the exec.
    return Usage(used.ru_utime + used.ru_stime, seconds)
