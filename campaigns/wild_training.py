"""Wild training: conditions that no training is made for, with every method.

A run has to survive (it ends, its state and its renders are finite) or to end with a message that
has the reason. It must never end in an error that nobody has foreseen, write a state that is not
finite, be killed, or go on for ever.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from campaign import Campaign, Detail, Outcome, Promise
from training_runs import QUIET, Judged, Verdict, judge, run_verb
from wild_captures import photographed
from wild_conditions import CONDITIONS, Condition

from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

STEPS, SECONDS = 80, 240.0
"""Steps of a run, in which density control refines several times, and its time at most."""
RATES = ("_lr", "_lr_final")
"""Endings of the keys of learning rates."""


@dataclass(frozen=True)
class Way:
    """A method, and parts of a run that it is tried with."""

    name: str
    settings: Sequence[str]
    is_static: bool = False


WAYS = (
    Way("3dgs", ("method=3dgs",), is_static=True),
    Way(
        "3dgs with mcmc",
        (
            "method=3dgs",
            "strategy=mcmc",
            "strategy.cap_max=400",
        ),
        is_static=True,
    ),
    Way(
        "3dgs with poses",
        (
            "method=3dgs",
            "refine_poses=true",
            "exposure=true",
        ),
        is_static=True,
    ),
    Way("4dgs", ("method=4dgs",)),
    Way("4d-rotor", ("method=4d-rotor",)),
    Way("dynamic3dgs", ("method=dynamic3dgs",)),
    Way("spacetime", ("method=spacetime",)),
)


@dataclass(frozen=True)
class WildRun:
    """A condition, a way to train, and the seed of both."""

    condition: Condition
    way: Way
    seed: int

    def __str__(self) -> str:
        return f"{self.way.name}, {self.condition.name}, seed {self.seed}"


def runs(size: int, seed: int) -> Iterator[WildRun]:
    """The first ``size`` runs: all conditions in one way each, then in the next, then new seeds."""
    while True:
        for turn in range(len(WAYS)):
            for number, condition in enumerate(CONDITIONS):
                ways = [way for way in WAYS if not (condition.is_of_time and way.is_static)]
                if turn < len(ways):
                    if size == 0:
                        return
                    size -= 1
                    yield WildRun(condition, ways[(number + turn) % len(ways)], seed)
        seed += 1


def arguments(run: WildRun, data: Path, out: Path) -> list[str]:
    """The command of a run."""
    words = [*run.way.settings, *QUIET, f"data={data}", f"steps={STEPS}", f"seed={run.seed}"]
    words += ["log_every=20", f"checkpoint_every={STEPS // 2}", *run.condition.settings]
    if run.condition.rates != 1.0:
        words += [f"{key}={run.condition.rates * rate!r}" for key, rate in _rates(run.way).items()]
    return ["train", *words, f"out={out}"]


def try_run(run: WildRun, folder: Path) -> Judged:
    """Train once.

    Args:
        run: what is tried.
        folder: empty; for its data and results.
    """
    capture = photographed(moving=not run.way.is_static)
    data = run.condition.damage(capture, np.random.default_rng(run.seed)).write(folder / "data")
    command = arguments(run, data, folder / "run")
    return judge(run_verb(command, folder, SECONDS), folder / "run")


def _rates(way: Way) -> dict[str, float]:
    """The learning rates of a run, by key."""
    given = dict(word.split("=", 1) for word in (*way.settings, "device=cpu"))
    flat = resolve(installed(), [Layer(COMMAND_LINE, given)]).flat()
    return {key: value for key, value in flat.items() if key.endswith(RATES)}


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Try conditions and methods; see ``Campaign.run``."""
    found: dict[WildRun, Judged] = {}
    for each in runs(size, seed):
        with tempfile.TemporaryDirectory() as folder:
            found[each] = judged = try_run(each, Path(folder))
        say(f"{each}: {judged.verdict.value}: {judged.reason[:200]}")
    counts = Counter(judged.verdict for judged in found.values())
    broken = [f"{each}: {judged.reason}" for each, judged in found.items()
              if judged.verdict is Verdict.BROKEN]  # fmt: skip
    conditions, ways = len({each.condition.name for each in found}), len({e.way for e in found})
    promise = Promise(
        "A training with extreme inputs has finite results, or ends with a message.",
        f"{conditions} conditions (rates, cameras, images, points, times, sizes) with {ways} "
        f"configurations (5 methods), {STEPS} steps each; every run is a process of its own.",
        f"{len(found):,} runs: {counts[Verdict.SURVIVED]:,} trained, {counts[Verdict.TOLD]:,} "
        f"ended with a message, {counts[Verdict.BROKEN]:,} broke the promise",
        holds=not broken,
    )
    return Outcome([promise], [_table(found)], broken)


def _table(found: dict[WildRun, Judged]) -> Detail:
    """The ends of the runs, by condition."""
    rows = []
    for condition in dict.fromkeys(each.condition for each in found):
        those = [judged for each, judged in found.items() if each.condition == condition]
        counts = Counter(judged.verdict for judged in those)
        told = [judged.reason for judged in those if judged.verdict is Verdict.TOLD]
        rows.append([condition.name, *(counts[verdict] for verdict in Verdict), _first(told)])
    return Detail(
        "Runs by condition, with the first message of the refused ones:",
        ("condition", *(verdict.value for verdict in Verdict), "message"),
        rows,
    )


def _first(messages: Sequence[str]) -> str:
    """The first sentence of the first message."""
    return messages[0].split(". ")[0].rstrip(".") if messages else ""


CAMPAIGN = Campaign(
    "wild-training",
    "trainings under conditions that nobody would choose",
    "runs",
    sum(not (each.is_of_time and way.is_static) for each in CONDITIONS for way in WAYS),
    run,
)
