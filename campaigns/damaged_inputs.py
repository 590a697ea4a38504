"""Damaged inputs: every reader of files is given a million damaged files in all.

Each target has a process of its own, so that a crash of native code is one finding, not the end.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty
from typing import Any

import torch
from campaign import ROOT, Campaign, Detail, Outcome, Promise

sys.path.insert(0, str(ROOT / "tests"))

from input_targets import Target, targets
from support.reader_faults import FACTOR, FIXED_BYTES, HEADROOM, SECONDS
from trial import Finding, Tally, tried

MOST_CRASHES = 10
"""Crashes of a target after which it is left."""
PATIENCE = 90.0
"""Seconds without a further execution after which a process waits for something that never comes:
the alarm of a reader counts only what the processor does."""
MEMORY = Path("/dev/shm")
"""A file system in memory, where there is one."""


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Let every target read its share of ``size`` damaged files."""
    torch.set_num_threads(1)  # OpenMP's threads do not survive the start of a process.
    base = MEMORY if os.access(MEMORY, os.W_OK) else None
    keep = Path(tempfile.gettempdir(), f"gsfw-damaged-inputs-{seed}")
    with tempfile.TemporaryDirectory(dir=base) as name:
        folder = Path(name)
        found = targets(folder / "splats")
        total = sum(target.share for target in found)
        tallies = []
        for number, target in enumerate(found):
            count = max(1, round(size * target.share / total))
            tally = isolated(target, folder / f"{number}", count, seed, keep)
            tallies.append(tally)
            say(_line(tally))
            for finding in tally.findings:
                say(f"  {finding}")
    return outcome(tallies)


def isolated(target: Target, folder: Path, count: int, seed: int, keep: Path) -> Tally:
    """The trial of a target in a process of its own; goes on after a crash."""
    context = multiprocessing.get_context("fork")
    whole, first = Tally(target.name), 0
    while first < count and len(whole.findings) < MOST_CRASHES:
        latest, answer = context.Value("q", first), context.Queue()
        numbers = range(first, count)
        arguments = (target, folder, numbers, seed, keep, latest, answer)
        process = context.Process(target=_try, args=arguments)
        process.start()
        part = _answer(process, latest, answer)
        if part is None:
            number = int(latest.value)
            part = Tally(target.name, number - first + 1)
            part.findings.append(_crash(target, seed, number, process.exitcode, folder, keep))
            first = number + 1
        else:
            first = count
        _add(whole, part)
        shutil.rmtree(folder, ignore_errors=True)
    return whole


def _try(
    target: Target,
    folder: Path,
    numbers: range,
    seed: int,
    keep: Path,
    latest: Any,  # noqa: ANN401 - of multiprocessing
    answer: Any,  # noqa: ANN401
) -> None:
    """Run a trial in this process."""

    def begin(number: int) -> None:
        latest.value = number

    start = time.process_time()
    tally = tried(target, folder, numbers, seed, keep, begin)
    tally.seconds = time.process_time() - start
    answer.put(tally)


def _answer(process: Any, latest: Any, answer: Any) -> Tally | None:  # noqa: ANN401
    """The counts of a process; ``None`` if it has died, or waits for something that never comes."""
    number, since = -1, time.monotonic()
    while True:
        try:
            tally: Tally = answer.get(timeout=0.5)
        except Empty:
            if not process.is_alive() and answer.empty():
                process.join()
                return None
            if latest.value != number:
                number, since = latest.value, time.monotonic()
            elif time.monotonic() - since > PATIENCE:
                process.kill()
                process.join()
                return None
            continue
        process.join()
        return tally


def _crash(
    target: Target, seed: int, number: int, code: int | None, folder: Path, keep: Path
) -> Finding:
    """The finding of a process that died; the damaged files are still in its folder."""
    name = signal.Signals(-code).name if code is not None and code < 0 else f"code {code}"
    to = keep / f"{target.name}-{number}-crash".replace(" ", "-")
    shutil.rmtree(to, ignore_errors=True)
    if folder.is_dir():
        shutil.copytree(folder, to, symlinks=True)
    fault = f"the process ended by {name}"
    return Finding(target.name, seed, number, "", "see the files", fault, str(to))


def _add(whole: Tally, part: Tally) -> None:
    for name in ("executions", "refused", "measured", "kept", "seconds"):
        setattr(whole, name, getattr(whole, name) + getattr(part, name))
    whole.lines = max(whole.lines, part.lines)
    whole.findings += part.findings


def _line(tally: Tally) -> str:
    rate = tally.executions / max(tally.seconds, 1e-9)
    return (
        f"{tally.target}: {tally.executions:,} executions ({rate:,.0f} per second), "
        f"{tally.refused:,} refused, {tally.lines:,} lines, {tally.kept} files kept, "
        f"{len(tally.findings)} findings"
    )


def outcome(tallies: Sequence[Tally]) -> Outcome:
    """Promises and tables from the counts of all targets."""
    findings = [finding for tally in tallies for finding in tally.findings]
    large = [finding for finding in findings if "allocated" in finding.fault]
    executions = sum(tally.executions for tally in tallies)
    refused = sum(tally.refused for tally in tallies)
    measured = sum(tally.measured for tally in tallies)
    others = len(findings) - len(large)
    return Outcome(
        [
            Promise(
                "A damaged file is read or refused with a message. No traceback, no crash, no hang "
                f"of more than {SECONDS:g} s and no value that is not finite follows.",
                "Random changes of valid files and of the names in them, guided by the coverage "
                "of gsfw's code; data sets with one damaged, absent or linked file.",
                f"{executions:,} executions of {len(tallies)} readers, {refused:,} refused with a "
                f"message, {others} kinds of faults",
                not others,
            ),
            Promise(
                "A header or an archive cannot make a reader allocate more memory than its file "
                "justifies.",
                f"The limit of memory is {FIXED_BYTES >> 20} MB plus {FACTOR} times the files; "
                f"all executions have {HEADROOM >> 20} MB of address space left.",
                f"{measured:,} executions measured, {len(large)} kinds of faults",
                not large,
            ),
        ],
        [
            Detail(
                'Executions by reader. "Lines" counts the covered lines of gsfw, "files" the '
                "files that reached new lines.",
                ("reader", "executions", "refused", "lines", "files", "faults"),
                [
                    (t.target, t.executions, t.refused, t.lines, t.kept, len(t.findings))
                    for t in tallies
                ],
            )
        ],
        [str(finding) for finding in findings],
    )


CAMPAIGN = Campaign(
    "damaged-inputs",
    "every reader of files is given damaged ones",
    "executions",
    1_000_000,
    run,
)
