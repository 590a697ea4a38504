"""Races: a command twice at once in one place, a random time apart, and what is left of it."""

from __future__ import annotations

import random
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from campaign import Campaign, Detail, Outcome, Promise
from forked_commands import Command, Ended, Server
from interrupted_work import WORKS, Tally, Work, WorkPlace, make_inputs

SHARES = {"train": 0.34, "resume": 0.2, "export": 0.24, "prepare": 0.14, "study": 0.08}
"""Parts of the races for each verb."""
AT_ONCE = 0.4
"""Part of the races in which both start at once; the others start within the first one's time."""
REFUSED = 2
ENDS = ("both done", "one refused", "both refused")
"""Ends of two commands, by the number of those that are refused."""


class Races:
    """Runs works twice at once."""

    def __init__(self, servers: Sequence[Server], base: Path, seed: int) -> None:
        """Race in one place.

        Args:
            servers: two, each of which runs a command at a time.
            base: folder of the place, and of the ``inputs`` of ``make_inputs``.
            seed: of the times.
        """
        self.servers, self.work_place = (
            servers,
            WorkPlace(servers[0], base / "work", base / "inputs"),
        )
        self.seed, self.random, self.tally = seed, random.Random(seed), Tally()

    def race(self, verb: str, number: int) -> None:
        """Run a work of a verb twice at once, and once more."""
        works = WORKS["train" if verb == "resume" else verb]
        work = works[number % len(works)]
        seconds, apart = self.work_place.known(work).ended.seconds, 0.0
        command = self.work_place.begin(work)
        if verb == "resume":
            command = self._begun(work, command, seconds)
        if self.random.random() > AT_ONCE:
            apart = self.random.random() * seconds
        ends = self._both(command, apart)
        self.tally.counts[verb, how(ends)] += 1
        found = [*race_problems(ends), *self.work_place.problems_of_going_on(work)]
        self.tally.failures += [
            f"{verb}, {work.name}, seed {self.seed}, {apart:.3f} s apart: {each}" for each in found
        ]

    def _begun(self, work: Work, command: Command, whole: float) -> Command:
        """Kill a training in its second half; the command that goes on with it."""
        seconds = whole * (0.5 + 0.4 * self.random.random())
        killed = Command(command.words, command.folder, signals=((seconds, signal.SIGKILL),))
        self.servers[0].run(killed)
        return self.work_place.going_on(work)

    def _both(self, command: Command, apart: float) -> list[Ended]:
        """The ends of a command that is run twice."""

        def second() -> Ended:
            time.sleep(apart)
            return self.servers[1].run(command)

        with ThreadPoolExecutor(2) as pool:
            ends = pool.submit(self.servers[0].run, command), pool.submit(second)
            return [end.result() for end in ends]


def how(ends: Sequence[Ended]) -> str:
    """The ends of two commands, in words."""
    refused = sum(end.code == REFUSED for end in ends)
    return ENDS[refused]


def race_problems(ends: Sequence[Ended]) -> Iterator[str]:
    """Tell faults of the ends of two commands."""
    for end in ends:
        if end.hung:
            yield "one hangs"
        elif end.code not in (0, REFUSED):
            yield f"exit code {end.code}: {end.complained[-300:]}"
        elif end.code == REFUSED and not end.error:
            yield "one is refused without a message"
        if "Traceback" in end.complained:
            yield f"one shows a traceback: {end.complained[-1500:]}"
    if all(end.code == REFUSED for end in ends):
        yield f"each is refused for the other: {ends[0].error.strip()}"


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Race ``size`` times; see ``Campaign.run``."""
    with tempfile.TemporaryDirectory(prefix="gsfw-races-") as folder:
        base = Path(folder)
        with Server(base / "one") as one, Server(base / "two") as two:
            make_inputs(one, base / "inputs")
            races = Races((one, two), base, seed)
            for verb, share in SHARES.items():
                for number in range(max(2, round(share * size))):
                    races.race(verb, number)
                races.tally.say(verb, "races", say)
    return outcome(races.tally)


def outcome(tally: Tally) -> Outcome:
    """The promise, with the counts."""
    rows = [[verb, *(tally.counts[verb, end] for end in ENDS)] for verb in SHARES]
    total = tally.total()
    promise = Promise(
        "Two commands at the same time in one folder do not disturb each other.",
        "A command runs twice, at the same time or a random time apart. At most one is refused, "
        "with a message, and the outputs have the bits of an undisturbed command.",
        f"{total} races of {', '.join(SHARES)}",
        not tally.failures,
    )
    return Outcome([promise], [Detail("Ends by verb:", ("verb", *ENDS), rows)], tally.failures)


CAMPAIGN = Campaign("races", "a command twice at once in one place", "races", 200, run)
