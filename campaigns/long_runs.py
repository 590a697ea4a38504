"""Long runs: one method on one capture for thousands of steps, and what has to hold at its end."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain
from pathlib import Path

import torch
from campaign import ROOT
from memory_trace import Drift, drift, read_trace
from training_runs import QUIET, Ended, Judged, Verdict, judge, run_verb

from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.kernels.cpu.native_module import instruction_set, instruction_sets

DATA = next(
    (path / "shared" / "data" for path in ROOT.parents if (path / "shared" / "data").is_dir()),
    ROOT.parent / "shared" / "data",
)
"""Captures beside the checkout, or beside the repository that it is a worktree of."""
TRACE = {"GSFW_PLUGIN_PATH": str(Path(__file__).resolve().parent / "memory_trace.py")}
CHECKPOINTS = 5
"""Checkpoints of a run besides its first: the last but one is where it is resumed."""
SLOWEST = 0.5
"""Seconds of a step, at which a run is ended."""
MOST_DRIFT = 64.0
"""Bytes by which the memory of a step may grow: 2 MB in 30,000 steps."""
MOST_GROWTH = 0.05
"""Part by which memory may grow over the second half of a run, in whatever way."""
RESULTS = ("psnr", "ssim")
"""Figures that an evaluation repeats."""
OTHER_BITS = "may differ in its last bits"
"""Words of a run that goes on with other instructions."""
SAME_QUALITY = 1.0
"""dB by which its PSNR may differ: errors of rounding grow in 6000 steps to other Gaussians."""
OWN_MACHINE = ("train_seconds", "environment")
"""Parts of a state that are of the machine."""

SMALL_FIELD = ("encoder=mlp", "mlp.width=16", "mlp.depth=2", "mlp.frequencies=2")
FEW = ("random_points=300", "strategy.max_gaussians=600")
FEW_MCMC = ("random_points=300", "strategy=mcmc", "strategy.cap_max=600")


@dataclass(frozen=True)
class LongRun:
    """A method on a capture."""

    data: str
    """Folder in ``DATA``; empty for the built-in scene."""
    method: str
    settings: Sequence[str]

    def __str__(self) -> str:
        return f"{self.method} on {Path(self.data).name or 'the built-in scene'}"

    def arguments(self, steps: int, seed: int, out: Path) -> list[str]:
        """The command."""
        words = [f"method={self.method}", *QUIET, *self.settings, f"steps={steps}", f"seed={seed}"]
        words += [f"data={DATA / self.data}"] if self.data else []
        words += ["eval_every=0", f"log_every={max(steps // 100, 1)}"]
        words += [f"checkpoint_every={max(steps // CHECKPOINTS, 1)}"]
        words += [f"callbacks.memory_trace.every={max(steps // 300, 1)}"]
        return ["train", *words, f"out={out}"]


LONG_RUNS = (
    LongRun("captures/fox", "3dgs", ("downscale=20", "init=random", *FEW)),
    LongRun("synthetic/chair", "3dgs", ("downscale=10", *FEW)),
    LongRun("dynamic/robot", "3dgs", ("downscale=10", "ignore_time=true", *FEW_MCMC)),
    LongRun("captures/plush", "3dgs", ("downscale=20", "init=random", *FEW)),
    LongRun("dynamic/robot", "spacetime", ("downscale=10", *FEW)),
    LongRun("dynamic/mujoco_texture", "spacetime", ("downscale=20", *FEW)),
    LongRun("dynamic/robot", "4dgs", ("downscale=16", *FEW, *SMALL_FIELD)),
    LongRun("dynamic/mujoco_texture", "4dgs", ("downscale=32", *FEW, *SMALL_FIELD)),
)
"""Five captures and three methods where they apply, so small that 30,000 steps take minutes."""


class Kind(Enum):
    """The promises that a fault of a long run breaks."""

    MEMORY = "memory"
    RESULT = "result"
    RESUME = "resume"
    PROCESSOR = "processor"
    EVALUATION = "evaluation"


@dataclass(frozen=True)
class Fault:
    """A fault of a long run."""

    kind: Kind
    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Endured:
    """A long run, and all that was found wrong with it."""

    run: LongRun
    judged: Judged
    drift: Drift
    faults: Sequence[Fault]

    @property
    def row(self) -> list[str | int | float]:
        """Row of the run in the table of the campaign."""
        figures = self.judged.figures
        return [
            str(self.run),
            int(figures.get("steps", 0)),
            int(figures.get("num_gaussians", 0)),
            round(float(figures.get("psnr") or 0.0), 2),
            int(figures.get("skipped_steps", 0)),
            round(self.drift.low / 1e6, 1),
            round(self.drift.high / 1e6, 1),
            round(self.drift.per_step, 1),
            "; ".join(map(str, self.faults)) or "none",
        ]


COLUMNS = (
    *("run", "steps", "Gaussians", "PSNR in dB", "skipped steps"),
    *("MB at half", "MB at the end", "bytes per step", "faults"),
)


def endure(run: LongRun, steps: int, seed: int, folder: Path, extra: Sequence[str] = ()) -> Endured:
    """Train long, evaluate, and go on from a checkpoint in the middle.

    Args:
        run: what is trained.
        steps: its length.
        seed: of the run.
        folder: empty; for its results.
        extra: further settings, such as a planted defect.
    """
    out = folder / "run"
    ended = run_verb([*run.arguments(steps, seed, out), *extra], folder, SLOWEST * steps, TRACE)
    judged = judge(ended, out)
    if judged.verdict is not Verdict.SURVIVED:
        return Endured(run, judged, Drift(0.0, 0.0, 0.0), [Fault(Kind.RESULT, judged.reason)])
    moved = drift(read_trace(out))
    found = {
        Kind.MEMORY: _faults_of_memory(moved),
        Kind.RESULT: chain(_faults_of_log(out), _faults_of_model(out)),
        Kind.EVALUATION: faults_of_evaluation(out, folder),
        Kind.RESUME: faults_of_resume(out, steps, folder),
        Kind.PROCESSOR: faults_of_other_processor(out, steps, folder),
    }
    faults = [Fault(kind, text) for kind, texts in found.items() for text in texts]
    return Endured(run, judged, moved, faults)


def _faults_of_memory(moved: Drift) -> Iterator[str]:
    if moved.per_step > MOST_DRIFT:
        yield f"memory grows by {moved.per_step:.0f} bytes a step"
    if moved.high > (1 + MOST_GROWTH) * moved.low:
        yield f"memory grows from {moved.low / 1e6:.0f} to {moved.high / 1e6:.0f} MB"


def _faults_of_model(out: Path) -> Iterator[str]:
    """Collapses that the run has found itself: one that stands still shows little."""
    for finding in json.loads(RunFolder(out).summary.read_text()).get("findings", []):
        if finding["collapse"]:
            yield f"the model collapsed ({finding['key']})"


def _faults_of_log(out: Path) -> Iterator[str]:
    """Logged losses that are not numbers: metrics.jsonl has null for them."""
    lines = [json.loads(line) for line in RunFolder(out).metrics_log.read_text().splitlines()]
    bad = [line["step"] for line in lines if line.get("loss") is None and "loss" in line]
    if bad:
        yield f"the loss of step {bad[0]} is not finite"


def faults_of_evaluation(out: Path, folder: Path) -> Iterator[str]:
    """Differences of ``gsfw eval`` from the figures at the end of the run."""
    run = RunFolder(out)
    logged = json.loads(run.summary.read_text())
    ended = run_verb(["eval", str(out), "json=true"], folder, 600.0)
    if ended.code != 0:
        yield f"gsfw eval ended with exit code {ended.code}"
        return
    found = json.loads(ended.out)
    yield from (
        f"gsfw eval has {name}={found.get(name)}, the run has {logged[name]}"
        for name in RESULTS
        if found.get(name) != logged[name]
    )


def faults_of_resume(out: Path, steps: int, folder: Path) -> Iterator[str]:
    """Differences in the last state of a run that goes on from its last checkpoint but one."""
    again = RunFolder(folder / "again")
    middle, ended = _resumed(out, again, steps, folder)
    if middle in ("no checkpoint", again.checkpoint(0).name):
        yield "gsfw resume has no checkpoint in the middle"
        return
    if ended.code != 0:
        yield f"gsfw resume from {middle} ended with exit code {ended.code}"
        return
    last = RunFolder(out).checkpoint(steps)
    other = first_difference(read_checkpoint(last), read_checkpoint(again.checkpoint(steps)))
    if other:
        yield f"gsfw resume from {middle}: {other} differs"


def faults_of_other_processor(out: Path, steps: int, folder: Path) -> Iterator[str]:
    """Faults of the same run, if it goes on with other instructions: bits differ, quality not."""
    other, again = other_instruction_set(), RunFolder(folder / f"again_{other_instruction_set()}")
    if not other:
        return
    middle, ended = _resumed(out, again, steps, folder, {"GSFW_CPU_ISA": other})
    judged = judge(ended, again.path)
    if judged.verdict is not Verdict.SURVIVED:
        yield f"gsfw resume from {middle} with {other}: {judged.reason}"
        return
    if OTHER_BITS not in ended.err:
        yield f"gsfw resume from {middle} with {other} does not say that bits may differ"
    logged = json.loads(RunFolder(out).summary.read_text())["psnr"]
    if abs(judged.figures["psnr"] - logged) > SAME_QUALITY:
        yield (
            f"gsfw resume from {middle} with {other} has PSNR {judged.figures['psnr']:.2f} dB, the "
            f"run {logged:.2f}"
        )


def other_instruction_set() -> str:
    """The one after that which kernels use here, which is the best; empty if there is none."""
    sets = [*instruction_sets(), ""]
    return sets[sets.index(instruction_set()) + 1]


def _resumed(
    out: Path, again: RunFolder, steps: int, folder: Path, environment: Mapping[str, str] = {}
) -> tuple[str, Ended]:
    """A copy of a run goes on from its last checkpoint but one: its name, and how that ended."""
    shutil.copytree(out, again.path)
    again.checkpoint(steps).unlink()
    again.summary.unlink()
    middle = again.latest_checkpoint()
    name = "no checkpoint" if middle is None else middle.name
    words = ["resume", str(again.path)]
    return name, run_verb(words, folder, SLOWEST * steps, {**TRACE, **environment})


def first_difference(one: object, other: object, where: str = "state") -> str:
    """The place of the first difference between two nested states; empty if all bits are alike."""
    if isinstance(one, torch.Tensor) and isinstance(other, torch.Tensor):
        is_alike = one.dtype == other.dtype and torch.equal(one, other)
        return "" if is_alike else where
    if isinstance(one, dict) and isinstance(other, dict):
        if one.keys() != other.keys():
            return f"keys of {where}"
        inner = (first_difference(one[key], other[key], f"{where}.{key}")
                 for key in one if key not in OWN_MACHINE)  # fmt: skip
        return next(filter(None, inner), "")
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        if len(one) != len(other):
            return f"length of {where}"
        pairs = enumerate(zip(one, other, strict=True))
        return next(
            filter(None, (first_difference(a, b, f"{where}[{i}]") for i, (a, b) in pairs)), ""
        )
    return "" if one == other else where
