"""Training runs of a campaign, each in a process of its own: how it ends, and if that is sound."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np

from gsfw.core.errors import DataError
from gsfw.core.loop.checkpoint_file import check_finite, read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.machine_memory import anonymous_memory

QUIET = ("device=cpu", "report=false", "callbacks.tensorboard.enabled=false")
"""Settings of every run: what these write is tried elsewhere."""
INNER_ERRORS = (
    "Traceback (most recent call last)",
    "failed unexpectedly",
    "no checkpoint can be written",
)
"""Phrases of errors that nobody has foreseen, in messages and in log.txt. A state that cannot be
written is an error of a part, and all parts of these runs are gsfw's own."""
LOOK = 0.02
"""Seconds between two looks at the memory of a process."""
TOLD = (1, 2)
"""Exit codes of a run that ends with a message: training failed, or the user can correct it."""
_PROCESSES = multiprocessing.get_context("forkserver")
_PROCESSES.set_forkserver_preload([
    "gsfw.commands.interface.new_training", "gsfw.commands.interface.training",
    "matplotlib.figure", "matplotlib.backends.backend_agg",
])  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """The end of a process."""

    code: int | None
    """Exit code, negative for a signal; ``None`` if the process had to be ended."""
    out: str = ""
    err: str = ""
    peak_bytes: int = 0
    """Largest anonymous memory (``RssAnon``) that was seen."""


class Verdict(Enum):
    """The ways in which a run may end."""

    SURVIVED = "trained"
    TOLD = "ended with a message"
    BROKEN = "broken"


@dataclass(frozen=True)
class Judged:
    """The verdict on a run, and the reason."""

    verdict: Verdict
    reason: str
    """The message of a run that was ended, what is broken, or the quality."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """Figures of metrics.json, of a completed run."""


def run_verb(
    arguments: Sequence[str], folder: Path, seconds: float, environment: Mapping[str, str] = {}
) -> Ended:
    """Run a verb of gsfw in a process of its own, with one thread.

    Args:
        arguments: the verb and its settings.
        folder: for what the process prints.
        seconds: after which it is ended.
        environment: variables of the process besides those of this one.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # The server of processes starts with it.
    out, err = folder / "out.txt", folder / "err.txt"
    variables = {"OMP_NUM_THREADS": "1", "GSFW_STATE_DIR": "none", **environment}
    process = _PROCESSES.Process(
        target=_verb, args=(list(arguments), str(out), str(err), variables)
    )
    process.start()
    end, peak = time.monotonic() + seconds, 0
    while process.is_alive() and time.monotonic() < end:
        process.join(LOOK)
        peak = max(peak, anonymous_memory(Path(f"/proc/{process.pid}/status")))
    code = process.exitcode
    if code is None:
        process.kill()
        process.join()
    return Ended(code, _text(out), _text(err), peak)


def judge(ended: Ended, folder: Path) -> Judged:
    """Judge how a training ended, and what it has left.

    Args:
        ended: its process.
        folder: of the run; may be missing.
    """
    run = RunFolder(folder)
    broken = _broken_process(ended, run) or _broken_files(ended, run)
    if broken:
        return Judged(Verdict.BROKEN, broken)
    if ended.code in TOLD:
        return Judged(Verdict.TOLD, _message(ended).replace(f"{folder.parent}/", ""))
    figures = json.loads(run.summary.read_text())
    return Judged(Verdict.SURVIVED, f"PSNR {figures.get('psnr', math.nan):.1f} dB", figures)


def _broken_process(ended: Ended, run: RunFolder) -> str:
    """The fault of a process; empty if it has none."""
    if ended.code is None:
        return "it did not end in its time"
    if ended.code < 0:
        return f"killed by signal {-ended.code}"
    for lines in (ended.err.splitlines(), _text(run.log).splitlines()):
        found = [line for line in lines if any(phrase in line for phrase in INNER_ERRORS)]
        if found:
            return found[-1]
    if ended.code and (ended.code not in TOLD or not _message(ended)):
        return f"exit code {ended.code}, and no message"
    return ""


def _broken_files(ended: Ended, run: RunFolder) -> str:
    """The fault of what a run has left; empty if there is none."""
    try:
        return _not_finite(run) or ("" if ended.code else _incomplete(run))
    except (DataError, OSError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


def _not_finite(run: RunFolder) -> str:
    """The first file of a run with numbers that are not finite; empty if there is none."""
    for path in sorted(run.checkpoints.glob("*.pt")):
        try:
            check_finite(read_checkpoint(path))
        except ValueError as error:
            return f"{path.name}: {error}"
    if run.splats.exists():
        content = run.splats.read_bytes()
        begin = content.index(b"end_header\n") + len(b"end_header\n")
        if not np.isfinite(np.frombuffer(content[begin:], np.float32)).all():
            return f"{run.splats.name} is not finite"
    return ""


def _incomplete(run: RunFolder) -> str:
    """The first thing that a completed run lacks; empty if it has all."""
    if not run.summary.exists():
        return "no metrics.json"
    figures = json.loads(run.summary.read_text())
    if figures.get("views") and not math.isfinite(figures.get("psnr") or math.nan):
        return f"psnr {figures.get('psnr')}"
    return "" if run.latest_checkpoint() else "no checkpoint"


def _message(ended: Ended) -> str:
    """The message of an error, in one line."""
    begin = ended.err.rfind("error: ")
    return " ".join(ended.err[begin + len("error: ") :].split()) if begin >= 0 else ""


def _verb(arguments: list[str], out: str, err: str, variables: dict[str, str]) -> None:
    """Run a verb in this process, which prints into files."""
    os.environ.update(variables)
    for number, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    from gsfw.commands.main import main

    sys.exit(main(arguments))


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""
