"""File faults: what goes wrong with a file operation of a process, by a library for LD_PRELOAD."""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).with_suffix(".c")


class Calls(IntFlag):
    """Kinds of system calls; the numbers are those of the library."""

    OPEN = 1
    """Opening a file to write."""
    WRITE = 2
    RENAME = 4
    FSYNC = 8
    TRUNCATE = 16
    """Changing or reserving a length."""
    CLOSE = 32
    MMAP = 64
    UNLINK = 128
    MKDIR = 256
    READ = 512
    """Opening a file to read."""


CHANGES = Calls(511)
"""All calls that change files, and closing."""
WINDOWS = Calls.OPEN | Calls.WRITE | Calls.RENAME | Calls.FSYNC | Calls.UNLINK | Calls.MKDIR
"""Calls between which the content of a folder differs."""


class Kind(IntEnum):
    """Fault of a call; the numbers are those of the library."""

    COUNT = 0
    FAIL = 1
    SHORT = 2
    """Half of the bytes are written, as a full disk or a signal may cause."""
    SIGNAL = 3
    """A signal comes before the call."""
    SIGNAL_AFTER = 4
    VANISH = 5
    """The folder is no longer there, as after the loss of a network mount."""


@dataclass(frozen=True)
class Fault:
    """One fault of a process and of those that it starts."""

    kind: Kind = Kind.COUNT
    calls: Calls = CHANGES
    number: int = 0
    """Error of a call that fails, or a signal. SIGKILL goes to the process group."""
    at: int = 0
    """Number of the call below the folder, from 1."""
    lasting: bool = False
    """True if all further calls fail too."""
    clock: int = 0
    """Seconds that the clock is moved."""
    clock_at: int = 0
    """Readings of the clock before it is moved."""

    def __str__(self) -> str:
        if self.clock:
            return f"clock moved by {self.clock} s after {self.clock_at} readings"
        kind = self.kind.name.lower()
        if self.kind is Kind.FAIL:
            kind = errno.errorcode[self.number]
        if self.kind in (Kind.SIGNAL, Kind.SIGNAL_AFTER):
            kind = f"{signal.Signals(self.number).name} {'before' if self.kind == 3 else 'after'}"
        calls = "|".join(each.name or "" for each in Calls if each in self.calls)
        return f"{kind} at call {self.at}{' and later' if self.lasting else ''} of {calls}"

    def environment(self, folder: Path, counter: Path) -> dict[str, str]:
        """Environment variables that give the fault to processes that are started."""
        numbers = (self.calls, self.kind, self.number, self.at, self.lasting)
        text = " ".join(str(int(each)) for each in numbers)
        clock = {"GSFW_CLOCK_FAULT": f"{self.clock} {self.clock_at}"} if self.clock else {}
        return {"GSFW_FILE_FAULTS": f"{text} {counter} {folder}", **clock}

    def begin(self, folder: Path, counter: Path, log: Path | None = None) -> None:
        """Begin with it in this process, which has the library loaded.

        Args:
            folder: only calls on files below it count.
            counter: file in which processes count together.
            log: file for all operations; ``None`` for no record.
        """
        library = ctypes.CDLL(None)
        library.faults_set(
            os.fsencode(folder), *map(ctypes.c_int, (self.calls, self.kind, self.number)),
            ctypes.c_long(self.at), ctypes.c_int(self.lasting), os.fsencode(counter),
            b"" if log is None else os.fsencode(log),
        )  # fmt: skip
        library.faults_clock(ctypes.c_long(self.clock), ctypes.c_long(self.clock_at))


def mark(text: str) -> None:
    """Note in the log of operations what the process has reported by now."""
    ctypes.CDLL(None).faults_mark(text.encode())


def compiler() -> str | None:
    """The C compiler; ``None`` where there is none, or no LD_PRELOAD."""
    return shutil.which("cc") if sys.platform == "linux" else None


@cache
def library() -> Path:
    """The compiled library, made once for each content of the source.

    Raises:
        RuntimeError: there is no C compiler, or this is not Linux.
    """
    found = compiler()
    if found is None:
        raise RuntimeError("the file faults need Linux and a C compiler (cc)")
    digest = hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    place = Path(tempfile.gettempdir()) / f"gsfw-file-faults-{os.getuid()}-{digest}.so"
    if not place.exists():
        made = place.with_name(f"{place.name}.{os.getpid()}")
        command = [found, "-shared", "-fPIC", "-O2", "-o", str(made), str(SOURCE), "-ldl"]
        subprocess.run([*command, "-lpthread"], check=True)
        made.replace(place)
    return place


def ends_at(at: int, after: bool = False, calls: Calls = WINDOWS) -> Fault:
    """SIGKILL before or after a call."""
    return Fault(Kind.SIGNAL_AFTER if after else Kind.SIGNAL, calls, signal.SIGKILL, at)


def fails_with(name: str, at: int, calls: Sequence[Calls], lasting: bool = False) -> Fault:
    """An error by its name in errno."""
    which = Calls(sum(calls))
    return Fault(Kind.FAIL, which, getattr(errno, name), at, lasting)
