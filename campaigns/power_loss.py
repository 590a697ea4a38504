"""Power loss: replays what a training has written up to any operation, as a disk may have kept it.

Each state must hold the last checkpoint that was reported as written, and no damaged file under a
file's final name. From some of them the training goes on.
"""

from __future__ import annotations

import json
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from campaign import Campaign, Detail, Outcome, Promise
from disk_states import Fate, Operation, read_log, states, write_state
from final_outputs import differences, final_outputs
from forked_commands import Server
from interrupted_work import LENGTH, Work, training

from gsfw.core.errors import DataError, UserError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.config_file import read_config

RESUMED_EVERY = 60
"""States after which one is trained to its end."""

WATCHED = ("metrics.jsonl", "eval/")
"""Lines and figures of before the checkpoint, which watchers write without synchronising."""


@dataclass
class Findings:
    """Counts, and what broke a promise."""

    states: Counter[str] = field(default_factory=Counter)
    """States by fate."""
    resumed: int = 0
    failures: list[str] = field(default_factory=list)


def reported_step(marks: Sequence[str]) -> int | None:
    """Step of the last checkpoint that was reported as written; ``None`` if there was none."""
    steps = [int(mark.split()[1]) for mark in marks if mark.startswith("checkpoint ")]
    return steps[-1] if steps else None


def problems_of(run: Path, reported: int | None, splats: bytes | None = None) -> Iterator[str]:
    """Tell faults of the files of a run after a power loss.

    Args:
        run: folder of the run; it need not be there.
        reported: step of the last checkpoint that was reported; ``None`` for none.
        splats: content of the final splats.ply; ``None`` to leave it out.
    """
    folder = RunFolder(run)
    steps = []
    for path in sorted(folder.checkpoints.glob("step_*.pt")):
        try:
            steps.append(int(read_checkpoint(path)["step"]))
        except DataError as error:
            yield f"a damaged checkpoint has its final name: {error.message}"
    if reported is not None:
        if not any(step >= reported for step in steps):
            yield f"checkpoint {reported} was reported, found: {steps}"
        if not folder.config.is_file():
            yield "there is no config.yaml beside the checkpoint"
    if folder.config.is_file():
        try:
            read_config(folder.config, everything=True)
        except UserError as error:
            yield f"damaged: {error.message}"
    for path in (folder.summary, folder.requirements, *folder.evaluations.glob("*.json")):
        try:
            json.loads(path.read_text()) if path.is_file() else None
        except ValueError:
            yield f"damaged: {path.name}"
    if splats is not None and folder.splats.is_file() and folder.splats.read_bytes() != splats:
        yield "damaged: splats.ply"


def check_states(
    operations: Sequence[Operation], root: Path, size: int, draw: random.Random,
    check: Callable[[Path, int | None, int], Iterator[str]],
) -> Findings:  # fmt: skip
    """Write states below a folder and check each; states that are equal are checked once.

    Args:
        operations: of the program.
        root: folder that the paths of the operations are below; states are written there.
        size: number of states.
        draw: chooses them.
        check: gets the folder, the step that was reported, and the number of the state.
    """
    found, known = Findings(), set()
    for number, (point, fate, marks, state) in enumerate(states(operations, size, draw)):
        found.states[fate.value] += 1
        reported = reported_step(marks)
        key = hash((reported, tuple(sorted(state.items(), key=lambda item: item[0]))))
        if key in known:
            continue
        known.add(key)
        shutil.rmtree(root, ignore_errors=True)
        root.mkdir()
        write_state(state, root, root)
        found.failures += [
            f"power loss after operation {point} of {len(operations)}, {fate.value}: {each}"
            for each in check(root, reported, number)
        ]
    return found


class Loss:
    """A training on a disk, and what is left of it after power losses."""

    def __init__(self, server: Server, base: Path, work: Work) -> None:
        self.server, self.root, self.resumed, self.work = server, base / "disk", 0, work
        self.run = self.root / "run"
        self.root.mkdir()
        log = base / "log"
        command = work.command(self.run, base)
        done = server.run(replace(command, folder=str(self.root), log=str(log)))
        if done.code:
            raise RuntimeError(done.complained)
        self.operations = read_log(log)
        self.outputs = final_outputs(self.run)
        self.splats = RunFolder(self.run).splats.read_bytes()

    def check(self, root: Path, reported: int | None, number: int) -> Iterator[str]:
        """Check a state, and go on from some."""
        yield from problems_of(self.run, reported, self.splats)
        if number % RESUMED_EVERY:
            return
        self.resumed += 1
        ended = self.server.run(self.work.going_on(self.run, root))
        if ended.code:
            yield f"going on ends with exit code {ended.code}: {ended.error.strip()}"
            return
        for each in differences(self.outputs, final_outputs(self.run)):
            if not each.startswith(WATCHED):
                yield f"after going on, {each}"


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Check states of the disk of a training."""
    with tempfile.TemporaryDirectory(prefix="gsfw-power-loss-") as folder:
        base = Path(folder)
        with Server(base / "server") as server:
            loss = Loss(server, base, training(*LENGTH))
            say(f"{len(loss.operations)} operations")
            draw = random.Random(seed)
            found = check_states(loss.operations, loss.root, size, draw, loss.check)
            found.resumed = loss.resumed
    found.failures = [f"seed {seed}: {each}" for each in found.failures]
    return outcome(found, len(loss.operations))


def outcome(found: Findings, operations: int) -> Outcome:
    """The promises, with the counts."""
    total = sum(found.states.values())
    return Outcome(
        [
            Promise(
                "A power loss destroys no checkpoint that was reported as written, and leaves no "
                "damaged file.",
                "All writes, renames and fsyncs of a training are recorded and replayed up to "
                "random operations. Operations that were not synchronised are kept, lost, "
                "replaced by zeros, or kept in part and in any order.",
                f"{total} states after {operations} operations, {found.resumed} trained to their "
                "end",
                not found.failures,
            )
        ],
        [
            Detail(
                "States by the fate of the operations that were not synchronised:",
                ("fate", "states"),
                [[fate.value, found.states[fate.value]] for fate in Fate],
            )
        ],
        found.failures,
    )


CAMPAIGN = Campaign(
    "power-loss",
    "states of a disk after a power loss during a training, then the way to go on",
    "states",
    4000,
    run,
)
