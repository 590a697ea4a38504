"""Failing disks: each file operation of a command fails in turn, in every way that disks fail."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from campaign import Campaign, Detail, Outcome, Promise
from file_faults import CHANGES, Calls, Fault, Kind, fails_with
from final_outputs import final_outputs
from forked_commands import Command, Ended, Server
from interrupted_work import WORKS, Tally, Work, WorkPlace, make_inputs

from gsfw.core.errors import DataError
from gsfw.core.loop.checkpoint_file import read_checkpoint

SHARES = {"train": 0.45, "export": 0.3, "prepare": 0.17, "study": 0.08}
"""Parts of the faults for each verb."""

WRITING = (Calls.OPEN, Calls.WRITE, Calls.MKDIR, Calls.TRUNCATE)
SYNCING = (Calls.FSYNC, Calls.CLOSE)
NAMING = (Calls.RENAME, Calls.UNLINK, Calls.MKDIR, Calls.OPEN)

WAYS: tuple[tuple[str, Sequence[Calls], str, bool], ...] = (
    ("full disk", WRITING, "ENOSPC", True),
    ("full disk for a moment", WRITING, "ENOSPC", False),
    ("quota", WRITING, "EDQUOT", True),
    ("read-only", (*NAMING, Calls.WRITE), "EROFS", True),
    ("I/O error", (*WRITING, *SYNCING, Calls.RENAME, Calls.UNLINK, Calls.MMAP), "EIO", False),
    ("dead disk", (*WRITING, *SYNCING, Calls.RENAME, Calls.UNLINK, Calls.READ), "EIO", True),
    ("error of fsync", (Calls.FSYNC,), "EIO", False),
    ("error of a rename", (Calls.RENAME,), "EIO", False),
    ("interrupted call", (Calls.OPEN, Calls.WRITE), "EINTR", False),
    ("stale mount", (*WRITING, *SYNCING, *NAMING, Calls.READ), "ESTALE", True),
)
"""Name of a way to fail, its calls, its error, and whether all further calls fail."""

MOUNTS = ("full file system", "unmounted")
"""Ways that need the right to mount."""

SOFT = ("tb/", "log.txt", "report", ".png")
"""Files whose loss does not end a command: what a watcher writes beside the results."""

MOST_ROOM = 1_000_000
"""Bytes of the largest full file system; a training fills it."""


@dataclass(frozen=True)
class Trial:
    """A fault of a work."""

    work: Work
    way: str
    fault: Fault | None
    """``None`` for a mount."""
    seconds: float = 0.0
    """Time at which a mount is lost."""
    room: int = 0
    """Bytes of a full file system."""

    def __str__(self) -> str:
        more = f" of {self.room} bytes" if self.room else f" at {self.seconds:.2f} s"
        return f"{self.work.name}, {self.way}" + (f", {self.fault}" if self.fault else more)


class Disks:
    """Tries faults of disks, in one place."""

    def __init__(self, server: Server, base: Path, seed: int) -> None:
        self.work_place = WorkPlace(server, base / "disk" / "work", base / "inputs")
        self.random, self.seed, self.tally = random.Random(seed), seed, Tally()
        self.ends: Counter[str] = Counter()
        self._calls: dict[tuple[Work, Calls], int] = {}
        (base / "disk").mkdir()
        self.may_mount = _may_mount(base / "mount")

    def calls(self, work: Work, calls: Calls) -> int:
        """Number of calls of some kinds that the undisturbed work makes, counted once."""
        if (work, calls) not in self._calls:
            command = replace(self.work_place.begin(work), fault=Fault(calls=calls))
            self._calls[work, calls] = self.work_place.server.run(command).calls
        return self._calls[work, calls]

    def trial(self, verb: str, number: int) -> Trial:
        """The trial of a number: all ways in turn, at random calls."""
        work = WORKS[verb][number % len(WORKS[verb])]
        names = [*(way[0] for way in WAYS), "short write", "vanished"]
        names += MOUNTS if self.may_mount else ()
        way = names[number % len(names)]
        if way in MOUNTS:
            seconds = self.random.random() * self.work_place.known(work).ended.seconds
            room = self.random.randint(4096, MOST_ROOM) if way == MOUNTS[0] else 0
            return Trial(work, way, None, seconds, room)
        found = next(((c, e, lasts) for name, c, e, lasts in WAYS if name == way), None)
        calls = Calls.WRITE if way == "short write" else CHANGES
        if found is not None:
            calls = Calls(sum(set(found[0])))
        at = self.random.randint(1, max(1, self.calls(work, calls)))
        if found is not None:
            return Trial(work, way, fails_with(found[1], at, (calls,), found[2]))
        kind = Kind.SHORT if way == "short write" else Kind.VANISH
        return Trial(work, way, Fault(kind, calls, at=at))

    def attempt(self, verb: str, trial: Trial) -> None:
        """Run a work with a fault, look at its end, and go on with a sound disk."""
        work = trial.work
        self.work_place.known(work)
        command = self.work_place.begin(work)
        if trial.fault is None:
            ended = self._with_mount(trial, command)
        else:
            ended = self.work_place.server.run(replace(command, fault=trial.fault))
            self._put_back()
        self.tally.counts[verb, trial.way] += 1
        self.ends[_end(ended)] += 1
        problems = [*ending_problems(ended), *self._damage(work)]
        if not ended.code:
            problems += [
                f"exit code 0, but {each}"
                for each in self.work_place.differences(work)
                if not any(name in each for name in SOFT)
            ]
        is_excused = not ended.code  # Then a note has told what could not be written.
        problems += [
            each
            for each in self.work_place.problems_of_going_on(work)
            if not (is_excused and any(name in each for name in SOFT))
        ]
        self.tally.failures += [f"{trial}, seed {self.seed}: {each}" for each in problems]

    def _damage(self, work: Work) -> Iterator[str]:
        """Files that were there, or that count as whole, and are not."""
        for path in self.work_place.place.rglob("step_*.pt"):
            try:
                read_checkpoint(path)
            except DataError as error:
                yield f"damaged: {error.message}"
        if work.inputs == "exported":
            path = self.work_place.place / Path(work.words[-1]).name
            old = path.is_file() and path.read_bytes() == b"a file of before"
            now = final_outputs(self.work_place.place).get(path.name) if path.is_file() else None
            if not old and now != self.work_place.known(work).outputs[path.name]:
                yield "the file of before is neither there nor replaced by a whole one"

    def _put_back(self) -> None:
        """Put a folder back that had vanished."""
        away = Path(f"{self.work_place.place}.away")
        if away.exists():
            shutil.rmtree(self.work_place.place, ignore_errors=True)
            away.rename(self.work_place.place)

    def _with_mount(self, trial: Trial, command: Command) -> Ended:
        """Run a command on a file system that is full, or lost after some time."""
        disk = self.work_place.place.parent
        kept = disk.with_name("kept")
        shutil.copytree(disk, kept)
        try:
            if trial.room:
                with mounted(["-t", "tmpfs", "-o", f"size={trial.room}", "tmpfs"], disk):
                    shutil.copytree(kept, disk, dirs_exist_ok=True)
                    ended = self.work_place.server.run(command)
                    shutil.rmtree(kept)
                    shutil.copytree(disk, kept)
            else:
                with mounted(["--bind", str(kept)], disk):
                    words = f"sleep {trial.seconds}; umount -l '{disk}'"
                    lost = subprocess.Popen(["sh", "-c", words])
                    ended = self.work_place.server.run(command)
                    lost.wait()
                    if not ended.code and self.work_place.place.exists():
                        # It was unmounted before the command began to write.
                        shutil.copytree(
                            self.work_place.place,
                            kept / self.work_place.place.name,
                            dirs_exist_ok=True,
                        )
            shutil.rmtree(disk)
            kept.rename(disk)
        finally:
            shutil.rmtree(kept, ignore_errors=True)
        return ended


@contextmanager
def mounted(words: Sequence[str], place: Path) -> Iterator[None]:
    """Mount a file system for a while; it may be unmounted meanwhile."""
    subprocess.run(["mount", *words, str(place)], check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False, capture_output=True)


def _may_mount(place: Path) -> bool:
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4096", "tmpfs", str(place)]
    if os.geteuid() or subprocess.run(command, capture_output=True, check=False).returncode:
        return False
    subprocess.run(["umount", str(place)], check=True)
    return True


def _end(ended: Ended) -> str:
    return {0: "completed", 2: "one sentence, exit code 2"}.get(
        ended.code, f"exit code {ended.code}"
    )


def ending_problems(ended: Ended) -> Iterator[str]:
    """Tell faults of the end of a command whose disk fails."""
    if ended.hung:
        yield "it hangs"
    if "Traceback" in ended.complained:
        yield f"it shows a traceback: {ended.complained[-1200:]}"
    if "failed unexpectedly" in ended.complained:
        yield f"no message for users: {ended.error.strip()}"
    if ended.code == 2 and f"\n{ended.complained}".count("\nerror: ") != 1:
        yield f"not one sentence: {ended.complained[-600:]}"
    # A study tells of the runs that have failed, and goes on.
    is_study = ended.code == 1 and ": failed: " in ended.said
    if ended.code not in (0, 2) and not is_study:
        yield f"exit code {ended.code}: {ended.complained[-600:]}"


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Try faults of all verbs."""
    with tempfile.TemporaryDirectory(prefix="gsfw-failing-disks-") as folder:
        base = Path(folder)
        with Server(base / "server") as server:
            make_inputs(server, base / "inputs")
            disks = Disks(server, base, seed)
            for verb, share in SHARES.items():
                for number in range(max(1, round(share * size))):
                    disks.attempt(verb, disks.trial(verb, number))
                disks.tally.say(verb, "faults", say)
    return outcome(disks)


def outcome(disks: Disks) -> Outcome:
    """The promises, with the counts."""
    total, counts = disks.tally.total(), disks.tally.counts
    ways = sorted({way for _, way in counts})
    rows = [[way, *(counts[verb, way] for verb in SHARES)] for way in ways]
    ends = ", ".join(f"{number} {name}" for name, number in sorted(disks.ends.items()))
    return Outcome(
        [
            Promise(
                "A command on a failing disk ends with a message of one sentence, or completes.",
                "A random open, write, rename, fsync, ftruncate, close, mmap, unlink or mkdir "
                "fails, once or from then on; short writes, full and lost file systems. A study "
                "lists the runs that failed, and ends with exit code 1.",
                f"{total} faults: {ends}",
                disks.tally.holds(
                    "traceback", "hangs", "no message", "not one", "exit code 1", "exit code -"
                ),
            ),
            Promise(
                "A failing disk damages no earlier file, and the command continues once the disk "
                "works again.",
                "Earlier checkpoints and files are read after each fault; then the command "
                "continues, and its outputs are compared with those of an undisturbed one.",
                f"{total} faults",
                disks.tally.holds("damaged", "neither", "going on", "exit code 0, but"),
            ),
        ],
        [Detail("Faults by kind and verb:", ("kind", *SHARES), rows)],
        disks.tally.failures,
    )


CAMPAIGN = Campaign(
    "failing-disks",
    "errors of file operations, full and lost disks, then the way to go on",
    "faults",
    240,
    run,
)
