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
from final_outputs import differences, final_outputs
from forked_commands import Command, Ended, Server
from interrupted_work import WORKS, Undisturbed, Work, make_inputs, undisturbed

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
        self.server, self.place, self.inputs = server, base / "disk" / "work", base / "inputs"
        self.random, self.seed = random.Random(seed), seed
        self.counts: Counter[tuple[str, str]] = Counter()
        """Number of trials, by verb and way."""
        self.ends: Counter[str] = Counter()
        self.failures: list[str] = []
        self._known: dict[tuple[Work, Calls], Undisturbed] = {}
        (base / "disk").mkdir()
        self.may_mount = _may_mount(base / "mount")

    def known(self, work: Work, calls: Calls = CHANGES) -> Undisturbed:
        """The undisturbed run of a work with the number of its calls, made once."""
        if (work, calls) not in self._known:
            work.begin(self.place, self.inputs)
            command = replace(work.command(self.place, self.inputs), fault=Fault(calls=calls))
            first = next((known for (item, _), known in self._known.items() if item == work), None)
            if first is None:
                first = undisturbed(self.server, work, self.place, self.inputs)
                work.begin(self.place, self.inputs)
            self._known[work, calls] = replace(first, ended=self.server.run(command))
        return self._known[work, calls]

    def trial(self, verb: str, number: int) -> Trial:
        """The trial of a number: all ways in turn, at random calls."""
        work = WORKS[verb][number % len(WORKS[verb])]
        names = [*(way[0] for way in WAYS), "short write", "vanished"]
        names += MOUNTS if self.may_mount else ()
        way = names[number % len(names)]
        if way in MOUNTS:
            seconds = self.random.random() * self.known(work).ended.seconds
            room = self.random.randint(4096, MOST_ROOM) if way == MOUNTS[0] else 0
            return Trial(work, way, None, seconds, room)
        found = next(((c, e, lasts) for name, c, e, lasts in WAYS if name == way), None)
        calls = Calls.WRITE if way == "short write" else CHANGES
        if found is not None:
            calls = Calls(sum(set(found[0])))
        at = self.random.randint(1, max(1, self.known(work, calls).ended.calls))
        if found is not None:
            return Trial(work, way, fails_with(found[1], at, (calls,), found[2]))
        kind = Kind.SHORT if way == "short write" else Kind.VANISH
        return Trial(work, way, Fault(kind, calls, at=at))

    def attempt(self, verb: str, trial: Trial) -> None:
        """Run a work with a fault, look at its end, and go on with a sound disk."""
        work, known = trial.work, self.known(trial.work)
        work.begin(self.place, self.inputs)
        command = work.command(self.place, self.inputs)
        if trial.fault is None:
            ended = self._with_mount(trial, command)
        else:
            ended = self.server.run(replace(command, fault=trial.fault))
            self._put_back()
        self.counts[verb, trial.way] += 1
        self.ends[_end(ended)] += 1
        problems = [*ending_problems(ended), *self._damage(work)]
        if not ended.code:
            problems += [
                f"exit code 0, but {each}"
                for each in differences(known.outputs, final_outputs(self.place))
                if not any(name in each for name in SOFT)
            ]
        is_excused = not ended.code  # Then a note has told what could not be written.
        problems += [
            each
            for each in self._after(work, known)
            if not (is_excused and any(name in each for name in SOFT))
        ]
        self.failures += [f"{trial}, seed {self.seed}: {each}" for each in problems]

    def _damage(self, work: Work) -> Iterator[str]:
        """Files that were there, or that count as whole, and are not."""
        for path in self.place.rglob("step_*.pt"):
            try:
                read_checkpoint(path)
            except DataError as error:
                yield f"damaged: {error.message}"
        if work.inputs == "exported":
            path = self.place / Path(work.words[-1]).name
            old = path.is_file() and path.read_bytes() == b"a file of before"
            now = final_outputs(self.place).get(path.name) if path.is_file() else None
            if not old and now != self.known(work).outputs[path.name]:
                yield "the file of before is neither there nor replaced by a whole one"

    def _after(self, work: Work, known: Undisturbed) -> Iterator[str]:
        """Problems of going on with a sound disk."""
        for _ in range(3):
            ended = self.server.run(work.going_on(self.place, self.inputs))
            if not ended.code:
                break
        if ended.code:
            said = (ended.error or ended.complained[-300:] or ended.said[-300:]).strip()
            yield f"going on ends with exit code {ended.code}: {said}"
            return
        for each in differences(known.outputs, final_outputs(self.place)):
            yield f"after going on, {each}"

    def _put_back(self) -> None:
        """Put a folder back that had vanished."""
        away = Path(f"{self.place}.away")
        if away.exists():
            shutil.rmtree(self.place, ignore_errors=True)
            away.rename(self.place)

    def _with_mount(self, trial: Trial, command: Command) -> Ended:
        """Run a command on a file system that is full, or lost after some time."""
        disk = self.place.parent
        kept = disk.with_name("kept")
        shutil.copytree(disk, kept)
        try:
            if trial.room:
                with mounted(["-t", "tmpfs", "-o", f"size={trial.room}", "tmpfs"], disk):
                    shutil.copytree(kept, disk, dirs_exist_ok=True)
                    ended = self.server.run(command)
                    shutil.rmtree(kept)
                    shutil.copytree(disk, kept)
            else:
                with mounted(["--bind", str(kept)], disk):
                    words = f"sleep {trial.seconds}; umount -l '{disk}'"
                    lost = subprocess.Popen(["sh", "-c", words])
                    ended = self.server.run(command)
                    lost.wait()
                    if not ended.code and self.place.exists():
                        # It was unmounted before the command began to write.
                        shutil.copytree(self.place, kept / self.place.name, dirs_exist_ok=True)
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
                    before = len(disks.failures)
                    disks.attempt(verb, disks.trial(verb, number))
                    for line in disks.failures[before:]:
                        say(line)
                say(f"{verb}: {sum(disks.counts.values())} faults so far")
    return outcome(disks)


def outcome(disks: Disks) -> Outcome:
    """The promises, with the counts."""
    total = sum(disks.counts.values())
    ways = sorted({way for _, way in disks.counts})
    rows = [[way, *(disks.counts[verb, way] for verb in SHARES)] for way in ways]
    ends = ", ".join(f"{number} {name}" for name, number in sorted(disks.ends.items()))

    def holds(*words: str) -> bool:
        return not any(word in line for line in disks.failures for word in words)

    return Outcome(
        [
            Promise(
                "A command on a failing disk ends with a message of one sentence, or completes.",
                "A random open, write, rename, fsync, ftruncate, close, mmap, unlink or mkdir "
                "fails, once or from then on; short writes, full and lost file systems. A study "
                "lists the runs that failed, and ends with exit code 1.",
                f"{total} faults: {ends}",
                holds("traceback", "hangs", "no message", "not one", "exit code 1", "exit code -"),
            ),
            Promise(
                "A failing disk damages no earlier file, and the command continues once the disk "
                "works again.",
                "Earlier checkpoints and files are read after each fault; then the command "
                "continues, and its outputs are compared with those of an undisturbed one.",
                f"{total} faults",
                holds("damaged", "neither", "going on", "exit code 0, but"),
            ),
        ],
        [Detail("Faults by kind and verb:", ("kind", *SHARES), rows)],
        disks.failures,
    )


CAMPAIGN = Campaign(
    "failing-disks",
    "errors of file operations, full and lost disks, then the way to go on",
    "faults",
    240,
    run,
)
