"""Interrupted work: small commands of each kind that takes long, and how each goes on."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy
from final_outputs import final_outputs
from forked_commands import Command, Ended, Server
from PIL import Image

from gsfw.core.loop.run_folder import RunFolder

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support import captured

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

PHOTOS, PHOTO_SIZE = 6, (64, 48)


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
    """Six images of a lens with distortion, with their cameras in a transforms.json."""
    width, height = PHOTO_SIZE
    (folder / "images").mkdir(parents=True)
    frames = []
    for number in range(PHOTOS):
        angle = 2 * numpy.pi * number / PHOTOS
        values = numpy.add.outer(numpy.arange(height), numpy.arange(width)) * (number + 3) % 256
        pixels = numpy.stack([values, values[::-1], 255 - values], axis=2).astype(numpy.uint8)
        name = f"images/photo_{number}.png"
        Image.fromarray(pixels).save(folder / name)
        turn = numpy.eye(4)
        turn[:3, :3] = [
            [-numpy.sin(angle), 0, numpy.cos(angle)],
            [numpy.cos(angle), 0, numpy.sin(angle)],
            [0, 1, 0],
        ]
        turn[:3, 3] = 3 * turn[:3, 2]
        frames.append({"file_path": name, "transform_matrix": turn.tolist()})
    lens = {"fl_x": 60, "fl_y": 60, "cx": width / 2, "cy": height / 2, "k1": -0.05}
    document = {**lens, "w": width, "h": height, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(document))


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


def undisturbed(server: Server, work: Work, place: Path, inputs: Path) -> Undisturbed:
    """Run a work without a fault.

    Raises:
        RuntimeError: it fails.
    """
    work.begin(place, inputs)
    ended = server.run(work.command(place, inputs))
    if ended.code:
        raise RuntimeError(f"{work.name}: {ended.complained}")
    return Undisturbed(ended, final_outputs(place))
