"""Interrupted work: small commands of each kind that takes long, and how each goes on."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from final_outputs import differences, final_outputs
from forked_commands import Command, Ended, Server

from gsfw.core.loop.run_folder import RunFolder

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support import captured
from support.small_captures import ring, write_images, write_transforms

SCENE = (
    *("method=3dgs", "device=cpu", "datamanager.views=16", "datamanager.eval_views=2"),
    *("datamanager.width=32", "datamanager.height=24", "datamanager.points=300"),
)
"""The built-in scene, tiny."""

LENGTH = ("steps=24", "checkpoint_every=6", "eval_every=12", "log_every=4")

STUDY = """
title: A small study
settings:
  {steps: 10, checkpoint_every: 4, device: cpu, report: false, datamanager.moving: true,
   datamanager.views: 8, datamanager.times: 4, datamanager.eval_views: 2,
   datamanager.width: 32, datamanager.height: 24, datamanager.points: 150}
seeds: [1]
rows:
  still: {method: 3dgs, ignore_time: true}
  moves: {method: 4dgs}
scenes: {balls: {}}
columns: [psnr, num_gaussians]
"""

PHOTOS = 6
MOST_TRIES = 4
"""Times that a command may be given until it ends with exit code 0."""


@dataclass(frozen=True)
class Work:
    """A command, and how it goes on."""

    name: str
    """Name of the verb, and of its kind."""
    words: tuple[str, ...]
    """Arguments of the command, which writes below {place} and reads below {inputs}."""
    goes_on: Callable[[Path], tuple[str, ...] | None] = lambda place: None
    """Arguments that go on with what is in the place; ``None`` for the same command."""
    inputs: str = ""
    """Folder among the inputs that is copied to the place first; empty for none."""

    def command(self, place: Path, inputs: Path) -> Command:
        """The command, undisturbed.

        Args:
            place: folder that it writes into.
            inputs: folder of ``make_inputs``.
        """
        words = tuple(word.format(place=place, inputs=inputs) for word in self.words)
        return Command(words, str(place))

    def begin(self, place: Path, inputs: Path) -> None:
        """Make the place as it is before the command."""
        shutil.rmtree(place, ignore_errors=True)
        shutil.rmtree(f"{place}.away", ignore_errors=True)
        if self.inputs:
            shutil.copytree(inputs / self.inputs, place)

    def going_on(self, place: Path, inputs: Path) -> Command:
        """The command that goes on, as the documentation says."""
        words = self.goes_on(place)
        return self.command(place, inputs) if words is None else Command(words, str(place))


def training(*length: str) -> Work:
    """A training that goes on by ``gsfw resume`` from its first checkpoint on."""

    def resumed(place: Path) -> tuple[str, ...] | None:
        has_any = RunFolder(place).latest_checkpoint() is not None
        return ("resume", str(place)) if has_any else None

    return Work("train", ("train", *SCENE, *length, "out={place}"), resumed)


def _export(suffix: str, inputs: str = "") -> Work:
    words = ("export", "{inputs}/run", f"out={{place}}/model{suffix}")
    return Work(f"export {suffix}", words, inputs=inputs)


WORKS = {
    "train": (training(*LENGTH),),
    "export": (
        *map(_export, (".ply", ".spz", ".sog", ".gsfw", ".glb", ".ksplat")),
        # In place of a file of before.
        _export(".ply", "exported"),
        _export(".gsfw", "exported"),
        Work("export web", ("export", "{inputs}/run", "format=web", "out={place}/page")),
    ),
    "prepare": (
        Work("prepare cameras", ("prepare", "{inputs}/capture", "out={place}", "jobs=1")),
        Work("prepare photos", ("prepare", "{inputs}/photos", "out={place}", "jobs=1")),
    ),
    "study": (Work("study", ("study", "{inputs}/small.yaml", "out={place}")),),
    "tradeoff": (
        Work(
            "tradeoff of a model",
            ("tradeoff", "{inputs}/run", "axes=sh,precision", "repeats=1", "out={place}"),
        ),
        Work(
            "tradeoff of trainings",
            (
                *("tradeoff", *SCENE, "report=false", "steps=6", "checkpoint_every=2"),
                *("axes=antialias", "repeats=1", "jobs=1", "out={place}"),
            ),
        ),
    ),
}
"""The works of each verb."""


def make_inputs(server: Server, inputs: Path) -> None:
    """Make the files that the works read.

    Raises:
        RuntimeError: the training of the model fails.
    """
    inputs.mkdir(parents=True)
    (inputs / "small.yaml").write_text(STUDY)
    done = server.run(Command(("train", *SCENE, *LENGTH, f"out={inputs / 'run'}"), str(inputs)))
    if done.code:
        raise RuntimeError(done.complained)
    (inputs / "exported").mkdir()
    for name in ("model.ply", "model.gsfw"):
        (inputs / "exported" / name).write_bytes(b"a file of before")
    _write_capture(inputs / "capture")
    _write_photos(inputs / "photos")


def _write_capture(folder: Path) -> None:
    """Images of a lens with distortion, with their cameras in a transforms.json."""
    capture = ring(PHOTOS)
    write_images(folder, capture)
    write_transforms(folder / "transforms.json", capture, k1=-0.05)


def _write_photos(folder: Path) -> None:
    """Photos with texture from an arc, which cameras are found for."""
    cameras = captured.arc(PHOTOS, step=6.0, width=160, height=120)
    captured.write(folder, captured.photos(cameras), ".jpg")


@dataclass(frozen=True)
class Undisturbed:
    """An undisturbed run of a work."""

    ended: Ended
    """The end of the run, with the number of calls that a fault of its command counts."""
    outputs: Mapping[str, Any]


class WorkPlace:
    """A place where a server runs works, and their ends there when nothing disturbs them."""

    def __init__(self, server: Server, place: Path, inputs: Path) -> None:
        """A place to be emptied for each work.

        Args:
            server: runs the commands.
            place: folder that they write into.
            inputs: folder of ``make_inputs``.
        """
        self.server, self.place, self.inputs = server, place, inputs
        self._known: dict[Work, Undisturbed] = {}

    def begin(self, work: Work) -> Command:
        """Make the place as it is before a work; its command."""
        work.begin(self.place, self.inputs)
        return work.command(self.place, self.inputs)

    def going_on(self, work: Work) -> Command:
        """The command that goes on with what is in the place."""
        return work.going_on(self.place, self.inputs)

    def known(self, work: Work) -> Undisturbed:
        """The undisturbed run of a work, made once.

        Raises:
            RuntimeError: it fails.
        """
        if work not in self._known:
            ended = self.server.run(self.begin(work))
            if ended.code:
                raise RuntimeError(f"{work.name}: {ended.complained}")
            self._known[work] = Undisturbed(ended, final_outputs(self.place))
        return self._known[work]

    def differences(self, work: Work) -> Iterator[str]:
        """Outputs in the place that are not those of the undisturbed run."""
        return differences(self.known(work).outputs, final_outputs(self.place))

    def problems_of_going_on(self, work: Work) -> Iterator[str]:
        """Go on until the command is done; tell its error, or its wrong outputs."""
        for _ in range(MOST_TRIES):
            ended = self.server.run(self.going_on(work))
            if ended.code == 0 or ended.hung:
                break
        if ended.code:
            said = (ended.error or ended.complained[-300:] or ended.said[-300:]).strip()
            yield f"going on ends with exit code {ended.code}: {said}"
            return
        for each in self.differences(work):
            yield f"after going on, {each}"


@dataclass
class Tally:
    """Counts of a campaign, and what broke a promise."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Number of points, by verb and kind of point."""
    failures: list[str] = field(default_factory=list)
    told: int = 0
    """Number of failures that were said."""

    def total(self, *kinds: str) -> int:
        """Points of some kinds; of all without any."""
        return sum(n for (_, kind), n in self.counts.items() if kind in kinds or not kinds)

    def holds(self, *words: str) -> bool:
        """True if no failure has one of the words."""
        return not any(word in line for line in self.failures for word in words)

    def say(self, verb: str, noun: str, say: Callable[[str], None]) -> None:
        """Say the failures since the last time, and the number of points so far."""
        for line in self.failures[self.told :]:
            say(line)
        self.told = len(self.failures)
        say(f"{verb}: {self.total()} {noun} so far")
