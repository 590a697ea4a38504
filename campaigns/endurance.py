"""Endurance: long trainings, whose memory must not grow and whose results must be repeatable.

A leak test with steps of one kind, long runs of three methods on five captures, and one step of as
many Gaussians as 12 GB hold, whose memory has been estimated before.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from campaign import Campaign, Detail, Outcome, Promise
from large_step import LargeStep, large_step
from long_runs import (
    COLUMNS,
    DATA,
    LONG_RUNS,
    MOST_DRIFT,
    MOST_GROWTH,
    SAME_QUALITY,
    Endured,
    Kind,
    LongRun,
    endure,
    other_instruction_set,
)
from training_runs import Verdict

STEPS, GAUSSIANS = 30_000, 10_000_000
"""Steps of the long runs, and Gaussians of the large step, at full size."""
LEAK_SHARE = 2 / 3
"""Steps of the leak test over those of the long runs: 20,000."""
PLANTED = ("callbacks.memory_trace.leak=256",)
"""A leak that the test has to find, in bytes a step."""
SMALL = {"views": 6, "eval_views": 2, "width": 32, "height": 24, "points": 150}
LEAK_TEST = LongRun(
    "", "3dgs", (*(f"datamanager.{key}={value}" for key, value in SMALL.items()), "strategy=none")
)
"""Steps of one kind: no growth, and all images decoded early."""


@dataclass(frozen=True)
class Found:
    """All that a campaign has tried."""

    clean: Endured
    planted: Endured
    runs: Sequence[Endured]
    step: LargeStep


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Train for ``size`` steps, and less in proportion elsewhere; see ``Campaign.run``."""
    short = max(int(LEAK_SHARE * size), 1)

    def tried(each: LongRun, steps: int, extra: Sequence[str] = ()) -> Endured:
        with tempfile.TemporaryDirectory() as folder:
            found = endure(each, steps, seed, Path(folder), extra)
        say("; ".join(f"{name} {value}" for name, value in zip(COLUMNS, found.row, strict=True)))
        return found

    clean, planted = tried(LEAK_TEST, short), tried(LEAK_TEST, short, PLANTED)
    long = [tried(each, size) for each in LONG_RUNS if (DATA / each.data).is_dir()]
    with tempfile.TemporaryDirectory() as folder:
        step = large_step(GAUSSIANS * size // STEPS, Path(folder))
    say(str(step))
    return outcome(Found(clean, planted, long, step), size)


def outcome(found: Found, size: int) -> Outcome:
    """The promises, by what was found."""
    leak = found.planted.drift.per_step
    everything = [found.clean, *found.runs]
    failures = [f"{each.run}, {size:,} steps: {fault}" for each in everything
                for fault in each.faults]  # fmt: skip
    if leak <= MOST_DRIFT:
        failures.append("a planted leak of 256 bytes a step was not found")
    if not found.step.holds:
        failures.append(str(found.step))
    captures = len({each.run.data for each in found.runs})
    methods = len({each.run.method for each in found.runs})
    alike = [each for each in everything if each.judged.verdict is Verdict.SURVIVED]
    promises = [
        Promise(
            "Memory does not grow over the steps of a training.",
            f"{LEAK_SHARE * size:,.0f} steps of one kind, and the long runs: in the second half, "
            f"anonymous memory grows by at most {MOST_DRIFT:.0f} bytes a step, and by at most "
            f"{100 * MOST_GROWTH:.0f} % in all.",
            f"{found.clean.drift.per_step:.1f} bytes a step; a planted leak of 256 is measured as "
            f"{found.planted.drift.per_step:.1f}",
            holds=not _having(everything, Kind.MEMORY)
            and found.planted.drift.per_step > MOST_DRIFT,
        ),
        Promise(
            "Long trainings end with finite numbers and a model that shows the scene.",
            f"{size:,} steps, {methods} methods, {captures} captures at 1/10 to 1/32 of their "
            "size: every logged loss, the checkpoints, splats.ply, and the findings of the runs.",
            f"{len(found.runs)} runs, {len(_having(everything, Kind.RESULT))} of which failed",
            holds=not _having(everything, Kind.RESULT),
        ),
        Promise(
            "A run that continues from a checkpoint ends with the same bits.",
            "Each run is repeated from its last checkpoint but one. Model, moments, generators and "
            "all other state are compared.",
            f"{len(alike)} runs, {len(_having(everything, Kind.RESUME))} with a difference",
            holds=not _having(everything, Kind.RESUME),
        ),
        Promise(
            "A run continues with another instruction set, with a warning and the same quality.",
            f"The same checkpoint, with the kernels of {other_instruction_set() or 'none'}: "
            f"warning, finite numbers, PSNR within {SAME_QUALITY:g} dB.",
            f"{len(alike)} runs, {len(_having(everything, Kind.PROCESSOR))} with a fault",
            holds=not _having(everything, Kind.PROCESSOR) and bool(other_instruction_set()),
        ),
        Promise(
            "gsfw eval prints the figures that the run logged.",
            "PSNR and SSIM of every run, compared bit by bit.",
            f"{len(alike)} runs, {len(_having(everything, Kind.EVALUATION))} with a difference",
            holds=not _having(everything, Kind.EVALUATION),
        ),
        Promise(
            "A training takes about the memory that was estimated before it.",
            "Two steps with as many Gaussians of SH degree 1 as fit into 12 GB.",
            str(found.step),
            holds=found.step.holds,
        ),
    ]
    rows = [each.row for each in (found.clean, found.planted, *found.runs)]
    title = "Runs, with the memory of the second half; the second run has a planted leak:"
    return Outcome(promises, [Detail(title, COLUMNS, rows)], failures)


def _having(runs: Sequence[Endured], kind: Kind) -> list[Endured]:
    """The runs with a fault of a kind."""
    return [each for each in runs if any(fault.kind is kind for fault in each.faults)]


CAMPAIGN = Campaign(
    "endurance", "long trainings: memory, finite numbers, repeatable results", "steps", STEPS, run
)
