"""Trial: a target reads thousands of damaged files, under watch for time, memory and errors."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random

from file_sets import Damage, FileSet, applied
from guided_damage import TRACED, Corpus, Coverage
from input_targets import Target
from support.reader_faults import TRACED as MEASURED
from support.reader_faults import fault, little_memory, traced

from gsfw.core.errors import UserError

MOST_FINDINGS = 20
"""Most kinds of findings of a target that are listed."""


@dataclass
class Finding:
    """A kind of fault: the first execution that showed it, and how many did."""

    target: str
    seed: int
    execution: int
    label: str
    change: str
    fault: str
    place: str = ""
    """Folder that has the files, to repeat it."""
    count: int = 1

    def __str__(self) -> str:
        times = f", {self.count} times" if self.count > 1 else ""
        kept = f" (files in {self.place})" if self.place else ""
        where = f"{self.target}, {self.label}, seed {self.seed}, execution {self.execution}"
        return f"{where}: {self.change}: {self.fault[:300]}{times}{kept}"


@dataclass
class Tally:
    """Counts of a trial."""

    target: str
    executions: int = 0
    refused: int = 0
    """Files that ended in words."""
    measured: int = 0
    """Executions whose allocations were measured."""
    lines: int = 0
    """Lines of gsfw that were passed."""
    kept: int = 0
    """Files that led to new lines."""
    seconds: float = 0.0
    findings: list[Finding] = field(default_factory=list)

    def add(self, finding: Finding) -> bool:
        """Count a finding; true if it is the first of its kind."""
        kind = _kind(finding.fault)
        for other in self.findings:
            if _kind(other.fault) == kind:
                other.count += 1
                return False
        self.findings.append(finding)
        return len(self.findings) <= MOST_FINDINGS


def _kind(fault: str) -> str:
    """A fault without paths, numbers and quoted texts."""
    return re.sub(r"/\S+|'[^']*'|\"[^\"]*\"|[\d.e+-]+", "", fault)[:80]


def tried(
    target: Target,
    folder: Path,
    numbers: range,
    seed: int,
    keep: Path | None = None,
    begin: Callable[[int], None] = lambda number: None,
) -> Tally:
    """Let a target read damaged files.

    Args:
        target: the reader.
        folder: an empty one, best in memory.
        numbers: of the executions; each names a change.
        seed: of all changes.
        keep: folder that receives the files of findings.
        begin: called with the number of each execution before it.
    """
    tally, coverage = Tally(target.name), Coverage()
    sets = target.sets(folder / "sound")
    if not sets:
        raise ValueError(f"{target.name} has no sound files: add them to the list of targets")
    corpora = [Corpus(files) for files in sets]
    places = [folder / f"set-{number}" for number in range(len(sets))]
    for files, place in zip(sets, places, strict=True):
        files.write(place)
        for depth in range(9):  # What reading loads once is no memory of a damaged file.
            fault(partial(target.read, place / files.entry, depth), 1 << 30, lambda _: "")
    with little_memory():
        for number in numbers:
            begin(number)
            random = Random(f"{seed} {target.name} {number}")
            which = number % len(sets)
            change = corpora[which].next(random)
            found = _execute(target, sets[which], places[which], change, number, tally, coverage)
            if len(coverage.lines) > tally.lines:
                tally.lines = len(coverage.lines)
                tally.kept += 1
                corpora[which].keep(change)
            if found:
                said = Finding(target.name, seed, number, sets[which].label, str(change), found)
                if tally.add(said) and keep is not None:
                    said.place = _kept(keep, said, sets[which], places[which], change)
    return tally


def _execute(
    target: Target,
    files: FileSet,
    place: Path,
    change: Damage,
    number: int,
    tally: Tally,
    coverage: Coverage,
) -> str:
    """One execution; what is wrong with it, or nothing."""

    def read() -> object:
        try:
            return target.read(place / files.entry, number)
        except UserError:
            tally.refused += 1
            raise

    round_ = number // len(files.damageable)
    measures = round_ % MEASURED == 0
    notes = number // 2 % TRACED == 0 and not measures
    tally.executions += 1
    tally.measured += measures
    if target.writes:
        files.write(place)
    with applied(place, files, change) as size:
        whole = size + sum(map(len, files.files.values()))
        watch = traced() if measures else coverage.noted() if notes else nullcontext()
        with watch:
            return fault(read, whole, target.check)


def _kept(keep: Path, finding: Finding, files: FileSet, place: Path, change: Damage) -> str:
    """Copy the damaged files of a finding."""
    to = keep / f"{finding.target}-{finding.execution}".replace(" ", "-")
    shutil.rmtree(to, ignore_errors=True)
    with applied(place, files, change):
        shutil.copytree(place, to, symlinks=True)
    (to / "FAULT.txt").write_text(f"{finding}\nentry: {files.entry}\n")
    return str(to)
