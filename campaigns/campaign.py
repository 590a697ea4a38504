"""Campaign: a promise tried at scale, and the record of what came of it.

A campaign makes thousands of damaged files, kills processes at random points, or trains for hours.
Its short form runs in the tests, with planted defects that it must find. Its long form runs by
``python campaigns NAME`` and writes ``results/NAME.json``; the table of promises comes from these.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy
import torch

ROOT = Path(__file__).resolve().parent.parent
RESULTS = Path(__file__).resolve().parent / "results"


@dataclass(frozen=True)
class Promise:
    """A promise to users, and what was counted when it was tried."""

    promise: str
    """A sentence: "A damaged file ends in data or in a message"."""
    method: str
    """A sentence on how it was tried."""
    figure: str
    """Counts: "1,000,000 executions of 41 readers, 0 crashes"."""
    holds: bool


@dataclass(frozen=True)
class Detail:
    """A table with the figures of a campaign."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str | int | float]]


@dataclass(frozen=True)
class Outcome:
    """The promises that a campaign tried, and its figures."""

    promises: Sequence[Promise]
    details: Sequence[Detail] = ()
    failures: Sequence[str] = ()
    """Broken promises, a line each, with the seed that repeats them."""


@dataclass(frozen=True)
class Campaign:
    """A campaign that ``python campaigns NAME`` runs."""

    name: str
    summary: str
    counts: str
    """Unit of its size: "executions", "crash points"."""
    full: int
    """Size of the run whose figures are published."""
    run: Callable[[int, int, Callable[[str], None]], Outcome]
    """Called with the size, a seed and a function that shows a line of progress."""


@dataclass(frozen=True)
class Record:
    """An outcome, with what repeats it: date, machine, versions, command."""

    campaign: str
    date: str
    """ISO 8601."""
    command: str
    machine: str
    commit: str
    seconds: float
    promises: list[Promise] = field(default_factory=list)
    details: list[Detail] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def write(self, folder: Path = RESULTS) -> Path:
        """Write it as JSON, in place of the record of an earlier run."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.campaign}.json"
        path.write_text(json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n")
        return path

    @classmethod
    def read(cls, path: Path) -> Record:
        """Read what ``write`` wrote."""
        values = json.loads(path.read_text())
        values["promises"] = [Promise(**each) for each in values["promises"]]
        values["details"] = [Detail(**each) for each in values["details"]]
        return cls(**values)


def machine() -> str:
    """Processor, cores, system and versions: the conditions of a figure."""
    found = re.search(r"model name\s*:\s*(.+)", _text(Path("/proc/cpuinfo")))
    processor = found[1].strip() if found else platform.processor() or platform.machine()
    system = f"{platform.system()} {platform.release()}"
    python = f"Python {platform.python_version()}"
    libraries = f"torch {torch.__version__}, NumPy {numpy.__version__}"
    return f"{processor}, {os.cpu_count()} cores, {system}, {python}, {libraries}"


def commit() -> str:
    """The commit of the sources; empty outside a repository."""
    command = ["git", "-C", str(ROOT), "rev-parse", "--short=12", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def _text(path: Path) -> str:
    return path.read_text() if path.exists() else ""
