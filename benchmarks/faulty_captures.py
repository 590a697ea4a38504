"""Findings of `gsfw check` on captures that were made faulty, and on sound ones.

    python benchmarks/faulty_captures.py DATA [--only NAME] [--keep DIR]

DATA is the folder of the shared data sets (captures/fox, synthetic/chair, ...). It prints the table
of docs/results/checking.md, and ends with 1 if fewer than ten faults are named or a sound capture
is called faulty.
"""

# ruff: noqa: T201
from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import faults
from made_capture import MadeCapture

from gsfw.core.errors import DataError
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import resolve
from gsfw.preparation.check.examination import Examination
from gsfw.preparation.check.report import report_unreadable
from gsfw.preparation.finding import Verdict

SIDE, IMAGES = 480, 48
"""Size and number of the images of a faulty capture."""
SOUND = (
    "captures/fox",
    "captures/plush",
    "synthetic/chair",
    "dynamic/mujoco_collision",
    "dynamic/mujoco_deformation",
    "dynamic/mujoco_texture",
    "dynamic/robot",
    "dynamic/garden_robot_mv",
)
HARMLESS = {
    "exposure drifts", "few views", "no points", "one camera at each time", "open side",
    "copies", "clipped images", "blurred images", "few points", "few points in images",
    "photos without a camera",
}  # fmt: skip
"""Kinds that are true of sound captures as well: limits, but no faults. One photo of plush is
blurred indeed."""


@dataclass(frozen=True)
class Said:
    """Verdict of check."""

    verdict: str
    kinds: tuple[str, ...]
    """Findings, the gravest first, without those that are harmless."""
    text: str
    seconds: float


@dataclass(frozen=True)
class Trial:
    """A faulty capture, and what names its fault."""

    name: str
    make: Callable[[Mapping[str, MadeCapture]], MadeCapture]
    names: tuple[str, ...]
    """Kinds of findings of which one has to be there, and be the first."""


def trials() -> tuple[Trial, ...]:
    """All of them."""
    belong = ("images and poses do not belong together",)
    return (
        Trial("fox, two poses exchanged", lambda s: faults.poses_exchanged(s["fox"]),
              ("poses exchanged",)),
        Trial("fox, poses inverted", lambda s: faults.poses_inverted(s["fox"]),
              ("poses inverted",)),
        Trial("chair, poses inverted", lambda s: faults.poses_inverted(s["chair"]),
              ("poses inverted",)),
        Trial("plush, OpenCV axes for OpenGL", lambda s: faults.axes_mixed(s["plush"]),
              ("camera axes",)),
        Trial("plush, images flipped", lambda s: faults.images_flipped(s["plush"]),
              ("mirrored",)),
        Trial("fox, left-handed world", lambda s: faults.world_left_handed(s["fox"]),
              ("cannot be read: mirrored",)),
        Trial("fox, focal length x 1.5", lambda s: faults.focal_length_wrong(s["fox"]),
              ("focal length wrong",)),
        Trial("plush, a focal length for each image",
              lambda s: faults.focal_lengths_spread(s["plush"]), ("focal lengths differ",)),
        Trial("plush, masks of other names", lambda s: faults.masks_named_otherwise(s["plush"]),
              ("masks not used",)),
        Trial("plush, images shuffled", lambda s: faults.images_shuffled(s["plush"]), belong),
        Trial("chair, images shuffled", lambda s: faults.images_shuffled(s["chair"]), belong),
        Trial("fox and plush in one", lambda s: faults.two_scenes(s["fox"], s["plush"]),
              ("two scenes",)),
        Trial("plush, a third unlit", lambda s: faults.unlit(s["plush"]),
              ("unlit images",)),
        Trial("fox, one camera turned by 40 degrees", lambda s: faults.camera_turned(s["fox"]),
              ("cameras misplaced",)),
        Trial("chair, one camera turned by 40 degrees", lambda s: faults.camera_turned(s["chair"]),
              ("cameras misplaced",)),
        Trial("fox, points 10 times too far", lambda s: faults.points_of_another_scale(s["fox"]),
              ("points of another scale",)),
        Trial("plush, rolling shutter", lambda s: faults.rolling_shutter(s["plush"]),
              ("rolling shutter",)),
        Trial("chair on a turntable", lambda s: faults.turntable(s["chair"], s["fox"].images[0]),
              ("background does not move",)),
        Trial("garden, times shuffled", lambda s: faults.times_shuffled(s["garden"]),
              ("times out of order",)),
    )  # fmt: skip


def check(path: Path) -> Said:
    """Examine a data set as `gsfw check` does."""
    began = time.perf_counter()
    settings = resolve(installed(), _layers(path))
    try:
        data = open_data(settings)
    except DataError as error:
        document = report_unreadable(error)
        text = f"{error.message} {error.advice}"
        kind = "cannot be read" + ": mirrored" * ("is mirrored" in text)
        return Said(document["verdict"], (kind,), text, time.perf_counter() - began)
    try:
        examined = Examination.of(data, settings.config)
    finally:
        data.close()
    found = [finding for finding in examined.findings if finding.kind not in HARMLESS]
    text = " ".join(f"{finding.kind}: {finding.found} {finding.advice}" for finding in found)
    verdict = Verdict.of(examined.findings).value
    kinds = tuple(finding.kind for finding in found)
    return Said(verdict, kinds, text, time.perf_counter() - began)


def _layers(path: Path) -> object:
    from gsfw.commands.interface.arguments import Arguments, layers

    return layers(Arguments((), (("data", str(path)), ("method", "3dgs"))))


def sound_captures(data: Path) -> dict[str, MadeCapture]:
    """The captures that faults are made of."""
    paths = {
        "fox": "captures/fox", "plush": "captures/plush", "chair": "synthetic/chair",
        "garden": "dynamic/garden_robot_mv",
    }  # fmt: skip
    return {
        name: MadeCapture.of(
            open_data(resolve(installed(), _layers(data / path))), SIDE,
            IMAGES if name != "garden" else 240,
        )
        for name, path in paths.items()
    }  # fmt: skip


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", default="", help="trials whose name has this")
    parser.add_argument("--keep", type=Path, help="folder where the faulty captures stay")
    given = parser.parse_args()
    chosen = [trial for trial in trials() if given.only in trial.name]
    sources = sound_captures(given.data) if chosen else {}
    named, false = 0, 0
    print("| capture | expected | said | verdict | s |\n|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        for number, trial in enumerate(chosen):
            path = (given.keep or Path(folder)) / f"{number:02d}"
            said = check(trial.make(sources).write(path))
            right = bool(said.kinds) and said.kinds[0] in trial.names
            named += right
            _print_row(trial.name, trial.names[0], said, "" if right else "**no**: ")
            print(f"    {said.text}", file=sys.stderr)
    for path in (item for item in SOUND if given.only in item):
        said = check(given.data / path)
        false += bool(said.kinds)
        _print_row(path, "nothing", said, "**no**: " if said.kinds else "")
    print(f"\n{named} of {len(chosen)} faults named first; {false} sound captures called faulty")
    return int(named < min(10, len(chosen)) or false > 0)


def _print_row(name: str, expected: str, said: Said, mark: str) -> None:
    kinds = ", ".join(said.kinds) or "nothing"
    print(f"| {name} | {expected} | {mark}{kinds} | {said.verdict} | {said.seconds:.0f} |")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
