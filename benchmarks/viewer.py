"""Speed of the page of the viewer, and its cost for a run that trains.

    OMP_NUM_THREADS=2 python benchmarks/viewer.py [--gaussians 50000 200000 1000000] [--rounds 3]
        [--steps 300] [--seconds 10] [--settings data=PATH ...]

on a machine that does nothing else. Prints two Markdown tables. The pages are no browsers: they
speak the protocol of viser over a websocket, report poses as a hand does that drags, and count the
frames that come.

1. `gsfw view` of a PLY of random Gaussians with SH of degree 3, at 640 x 360: seconds from the
   start of the command to its address and to the first frame, frames per second while the page
   moves, and the time until an image is whole again once it is at rest.
2. `gsfw train method=3dgs` with no page, with a page at rest and with one that moves, in turns:
   wall time of a step between two checkpoints, and the ratio to no page in the same round.
"""

from __future__ import annotations

import argparse
import itertools
import math
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.viewer_page import ViewerPage, open_page

from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Sh, Splats
from gsfw.formats.ply import PlyExporter
from gsfw.viewer.view_state import Pose

SIZE = (640, 360)
POSES_PER_SECOND = 60
MODES = ("none", "at rest", "moving")


@dataclass(frozen=True)
class Shown:
    """Figures of a page of `gsfw view`."""

    address_seconds: float
    first_seconds: float
    moving_rate: float
    moving_width: float
    rest_seconds: float


def pose(turn: float) -> Pose:
    """A place on a circle around the origin, in the frame that opens a splat file."""
    half = 0.5 * turn
    place = (-2.5 * math.sin(turn), 0.0, -2.5 * math.cos(turn))
    return Pose(place, (math.cos(half), 0.0, math.sin(half), 0.0), 0.8)


def sphere(count: int) -> Splats:
    """Random Gaussians in a ball, as large as makes them overlap a few times."""
    made = torch.Generator().manual_seed(0)
    means = torch.randn(count, 3, generator=made)
    means *= torch.rand(count, 1, generator=made) ** (1 / 3) / means.norm(dim=1, keepdim=True)
    quats = torch.nn.functional.normalize(torch.randn(count, 4, generator=made), dim=1)
    size = 1.5 * count ** (-1 / 3)
    return Splats(
        means=means.double(),
        opacities=0.2 + 0.8 * torch.rand(count, generator=made).double(),
        colors=Sh(0.3 * torch.randn(count, 16, 3, generator=made).double(), 3),
        quats=quats.double(),
        scales=size * (0.3 + torch.rand(count, 3, generator=made)).double(),
    )


@contextmanager
def gsfw(*arguments: str) -> Iterator[tuple[str, float]]:
    """A command that serves a page: its address, and the seconds until it was printed."""
    began = time.monotonic()
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "gsfw", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        lines = []
        try:
            for line in process.stdout:
                lines.append(line)
                if found := re.search(r"http://127\.0\.0\.1:\S+", line):
                    drain = threading.Thread(target=process.stdout.read, daemon=True)
                    drain.start()
                    yield found[0], time.monotonic() - began
                    process.terminate()
                    process.wait(60)
                    drain.join(10)
                    return
            raise SystemExit(f"gsfw {' '.join(arguments)} printed no address:\n{''.join(lines)}")
        finally:
            if process.poll() is None:
                process.kill()


def move(page: ViewerPage, seconds: float, ended: threading.Event) -> list[int]:
    """Report poses, and take frames, for some seconds; the widths of the frames."""
    widths: list[int] = []

    def report() -> None:
        for number in itertools.count():
            if ended.wait(1 / POSES_PER_SECOND):
                return
            page.look(pose(0.3 * number / POSES_PER_SECOND))

    hand = threading.Thread(target=report)
    hand.start()
    end = time.monotonic() + seconds
    try:
        while time.monotonic() < end and not ended.is_set():
            try:
                widths.append(page.wait_for_frame(max(end - time.monotonic(), 0.1)).shape[1])
            except Exception:  # Time is up, or the run is over.
                break
    finally:
        ended.set()
        hand.join()
    return widths


def view(file: Path, seconds: float) -> Shown:
    """Open a file, and measure its page."""
    began = time.monotonic()
    with (
        gsfw("view", str(file), "device=cpu") as (address, address_seconds),
        open_page(address, SIZE) as page,
    ):
        page.look(pose(0.0))
        page.wait_for_frame(600)
        first = time.monotonic() - began
        page.wait_for_frame(600, width=SIZE[0])
        move(page, 2.0, threading.Event())  # The budget of frames learns their times.
        widths = move(page, seconds, threading.Event())
        rested = time.monotonic()
        page.look(pose(1.0))
        page.wait_for_frame(600, width=SIZE[0])
        rest = time.monotonic() - rested
    width = statistics.median(widths) if widths else math.nan
    return Shown(address_seconds, first, len(widths) / seconds, width, rest)


def step_ms(mode: str, folder: Path, settings: list[str], steps: int) -> tuple[float, float]:
    """Wall time of a step in the second half, and the frames per second that the page got."""
    rate = [0.0]
    arguments = ["train", "method=3dgs", *settings, f"steps={2 * steps}", f"out={folder}"]
    arguments += ["device=cpu", "rescale=false", f"checkpoint_every={steps}", "eval_every=0"]
    if mode == "none":
        command = [sys.executable, "-m", "gsfw", *arguments]
        subprocess.run(command, check=True, capture_output=True)
    else:
        with gsfw(*arguments, "viewer=true") as (address, _), open_page(address, SIZE) as page:
            page.look(pose(0.0))
            last = folder / "checkpoints" / f"step_{2 * steps:09d}.pt"
            ended, began, frames = threading.Event(), time.monotonic(), 0
            while not last.is_file():
                if mode == "moving":
                    frames += len(move(page, 1.0, threading.Event()))
                else:
                    frames += _taken(page, ended)
            rate[0] = frames / (time.monotonic() - began)
    moments = [
        (folder / "checkpoints" / f"step_{step:09d}.pt").stat().st_mtime_ns / 1e6
        for step in (steps, 2 * steps)
    ]
    return (moments[1] - moments[0]) / steps, rate[0]


def _taken(page: ViewerPage, ended: threading.Event) -> int:
    """Take a frame if one comes within a second."""
    try:
        page.wait_for_frame(1.0)
    except Exception:
        ended.wait(0.2)
        return 0
    return 1


def pages_table(counts: list[int], seconds: float, folder: Path) -> list[str]:
    """The first table."""
    lines = [
        "| Gaussians | address after | first frame after | frames/s moving | width moving "
        "| whole again after |",
        "|---|---|---|---|---|---|",
    ]
    for count in counts:
        file = folder / f"{count}.ply"
        PlyExporter().write(file, SplatFile(sphere(count)))
        shown = view(file, seconds)
        file.unlink()
        lines.append(
            f"| {count:,} | {shown.address_seconds:.1f} s | {shown.first_seconds:.1f} s "
            f"| {shown.moving_rate:.1f} | {shown.moving_width:.0f} | {shown.rest_seconds:.2f} s |"
        )
    return lines


def training_table(settings: list[str], steps: int, rounds: int, folder: Path) -> list[str]:
    """The second table."""
    times: dict[str, list[float]] = {mode: [] for mode in MODES}
    rates: dict[str, list[float]] = {mode: [] for mode in MODES}
    for number in range(rounds):
        for mode in MODES:
            run = folder / f"{number}-{mode.replace(' ', '-')}"
            took, rate = step_ms(mode, run, settings, steps)
            times[mode].append(took)
            rates[mode].append(rate)
    lines = ["| page | ms for a step | ratio to no page | frames/s |", "|---|---|---|---|"]
    for mode in MODES:
        ratios = [took / alone for took, alone in zip(times[mode], times["none"], strict=True)]
        spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
        lines.append(
            f"| {mode} | {statistics.median(times[mode]):.0f} "
            f"| {statistics.median(ratios):.2f} ({spread}) | {statistics.median(rates[mode]):.1f} |"
        )
    return lines


def tell(lines: list[str]) -> None:
    """Print a table."""
    sys.stdout.write("\n".join([*lines, "", ""]))
    sys.stdout.flush()


def main() -> None:
    """Measure, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--gaussians", type=int, nargs="*", default=[50_000, 200_000, 1_000_000])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--settings", nargs="*", default=[], help="of gsfw train")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gsfw-bench-") as folder:
        if given.gaussians:
            tell(pages_table(given.gaussians, given.seconds, Path(folder)))
        if given.rounds:
            tell(training_table(given.settings, given.steps, given.rounds, Path(folder)))


if __name__ == "__main__":
    main()
