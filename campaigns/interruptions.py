"""Interruptions: SIGKILL, signals and clock jumps at random points, and then the way to go on."""

from __future__ import annotations

import random
import signal
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from campaign import Campaign, Detail, Outcome, Promise
from file_faults import WINDOWS, Fault, Kind, ends_at
from final_outputs import negative_times
from forked_commands import Command, Ended, Server
from interrupted_work import MOST_TRIES, WORKS, Tally, Work, WorkPlace, make_inputs

SHARES = {"train": 0.42, "export": 0.28, "prepare": 0.2, "study": 0.06, "tradeoff": 0.04}
"""Parts of the points for each verb: longer commands get fewer."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LEAVING = {130, 128 + signal.SIGTERM, 128 + signal.SIGHUP}
"""Exit codes after a signal."""

DAY, YEAR = 86_400, 365 * 86_400


class Trials:
    """Tries points of works, in one place."""

    def __init__(self, server: Server, base: Path, seed: int) -> None:
        self.work_place = WorkPlace(server, base / "work", base / "inputs")
        self.seed, self.random, self.tally = seed, random.Random(seed), Tally()

    def killed(self, verb: str, number: int) -> None:
        """Kill a work of a verb at a random point, once or twice, and go on."""
        works = WORKS[verb]
        work = works[number % len(works)]
        self.work_place.known(work)
        kind = "at a random time" if number % 2 else "at a system call"
        at, ended = self._killed(
            work, work.command(self.work_place.place, self.work_place.inputs), kind
        )
        if ended is None:
            return
        self.tally.counts[verb, kind] += 1
        if number % 4 > 1:
            again, ended = self._killed(work, self.work_place.going_on(work), kind, False)
            if ended is not None:
                self.tally.counts[verb, "again while it continues"] += 1
                at = f"{at}, then {again}"
        self._check(work, at)

    def _killed(
        self, work: Work, command: Command, kind: str, is_first: bool = True
    ) -> tuple[str, Ended | None]:
        """Run a command and kill it; ``None`` where it ended before."""
        known = self.work_place.known(work).ended
        for _ in range(MOST_TRIES):
            command, at = self._with_kill(command, known, kind)
            if is_first:
                self.work_place.begin(work)
            ended = self.work_place.server.run(command)
            if ended.code:
                return at, ended
            if not is_first:
                break
        return at, None

    def _with_kill(self, command: Command, known: Ended, kind: str) -> tuple[Command, str]:
        """A command that is killed, and the point in words."""
        draw = self.random
        command = replace(command, orphans_end=draw.random() < 0.5)
        if kind == "at a system call":
            fault = ends_at(draw.randint(1, known.calls), draw.random() < 0.5)
            return replace(command, fault=fault), str(fault)
        seconds = draw.random() * known.seconds
        return replace(command, signals=((seconds, signal.SIGKILL),)), f"SIGKILL at {seconds:.2f} s"

    def interrupted(self, verb: str, number: int, which: signal.Signals) -> None:
        """Send a signal to a work of a verb at a random point, and go on."""
        works = WORKS[verb]
        work = works[number % len(works)]
        known = self.work_place.known(work).ended
        command = work.command(self.work_place.place, self.work_place.inputs)
        if number % 2:
            seconds = self.random.random() * known.seconds
            command = replace(command, signals=((seconds, which),))
            at = f"{which.name} at {seconds:.2f} s"
        else:
            call = self.random.randint(1, known.calls)
            fault = Fault(Kind.SIGNAL, WINDOWS, which, call)
            command, at = replace(command, fault=fault), str(fault)
        self.work_place.begin(work)
        ended = self.work_place.server.run(command)
        self.tally.counts[verb, which.name] += 1
        for problem in signal_problems(verb, ended, self.work_place.place):
            self._fail(work, at, problem)
        self._check(work, at)

    def with_clock(self, verb: str, offset: int) -> None:
        """Run a work whose clock jumps."""
        work = self.random.choice(WORKS[verb])
        fault = Fault(clock=offset, clock_at=self.random.randint(0, 60))
        self.work_place.known(work)
        ended = self.work_place.server.run(replace(self.work_place.begin(work), fault=fault))
        self.tally.counts[verb, "clock jump"] += 1
        if ended.code:
            self._fail(work, str(fault), f"exit code {ended.code}: {ended.error}")
            return
        for difference in self.work_place.differences(work):
            self._fail(work, str(fault), difference)
        for name in negative_times(self.work_place.place):
            self._fail(work, str(fault), f"{name} is negative")

    def _check(self, work: Work, at: str) -> None:
        for problem in self.work_place.problems_of_going_on(work):
            self._fail(work, at, problem)

    def _fail(self, work: Work, at: str, what: str) -> None:
        self.tally.failures.append(f"{work.name}, seed {self.seed}, {at}: {what}")


def signal_problems(verb: str, ended: Ended, place: Path) -> Iterator[str]:
    """Tell faults of the end of a command after a signal."""
    if ended.hung:
        yield "it hangs"
    elif ended.code not in {0, *LEAVING}:
        # A signal before the first line of the command ends the process as any other.
        early = ended.code in {-each for each in SIGNALS} and not ended.said
        of_a_run = ended.code == 1 and " from outside" in ended.said  # A study tells of it.
        if not (early or of_a_run):
            yield f"exit code {ended.code}: {ended.complained[-300:]}"
    if "Traceback" in ended.complained:
        yield f"it shows a traceback: {ended.complained[-1500:]}"
    begun, done = ((place / name).exists() for name in ("metrics.jsonl", "metrics.json"))
    stopped = verb == "train" and ended.code in LEAVING and begun and not done
    if stopped and "stopped after" not in ended.said:
        yield f"no checkpoint is said to be written: {ended.said[-300:]}"


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Try kill points, a third as many signals, and a twentieth as many clock jumps."""
    with tempfile.TemporaryDirectory(prefix="gsfw-interruptions-") as folder:
        base = Path(folder)
        with Server(base / "server") as server:
            make_inputs(server, base / "inputs")
            trials = Trials(server, base, seed)
            try_all(trials, size, say)
    return outcome(trials.tally)


def try_all(trials: Trials, size: int, say: Callable[[str], None]) -> None:
    """Try all points of all verbs."""
    for verb, share in SHARES.items():
        for number in range(max(2, round(share * size))):
            trials.killed(verb, number)
        for number in range(max(3, round(share * size / 3))):
            trials.interrupted(verb, number // 3, SIGNALS[number % 3])
        for number in range(max(2, round(share * size / 20))):
            trials.with_clock(verb, (-DAY, YEAR)[number % 2])
        trials.tally.say(verb, "points", say)


KILLS = ("at a random time", "at a system call", "again while it continues")
NAMES = tuple(each.name for each in SIGNALS)


def outcome(tally: Tally) -> Outcome:
    """The promises, with the counts."""
    columns = (*KILLS, *NAMES, "clock jump")
    rows = [[verb, *(tally.counts[verb, kind] for kind in columns)] for verb in SHARES]
    return Outcome(
        [
            Promise(
                "A killed command continues, and ends with the bits of an undisturbed one.",
                "SIGKILL to all its processes at random times, and before or after random system "
                "calls; then gsfw resume, or the same command.",
                f"{tally.total(*KILLS)} kills of {', '.join(SHARES)}",
                tally.holds("SIGKILL"),
            ),
            Promise(
                "Ctrl-C, SIGTERM and SIGHUP end a command with a message, and it can continue.",
                "Each signal at random times and system calls.",
                f"{tally.total(*NAMES)} signals",
                tally.holds(*NAMES),
            ),
            Promise(
                "A jump of the clock changes no result.",
                "The clock goes back a day, or forward a year, during the command.",
                f"{tally.total('clock jump')} jumps",
                tally.holds("clock moved"),
            ),
        ],
        [Detail("Points by verb:", ("verb", *(f"{each}" for each in columns)), rows)],
        tally.failures,
    )


CAMPAIGN = Campaign(
    "interruptions",
    "kills, signals and clock jumps at random points, then the way to go on",
    "kill points",
    200,
    run,
)
