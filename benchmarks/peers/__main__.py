"""Trains with several trainers in turns, scores all of them alike, prints tables, draws curves.

    PYTHONPATH=benchmarks python -m peers DATA --out DIR [--opensplat SOURCE] [--original SOURCE]

README.md in this folder has the method. A bench that was interrupted goes on where it stopped.
"""

# ruff: noqa: T201
from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

from gsfw.core.errors import DataError, UserError
from peers.capture import write_training_views
from peers.held_out import HeldOutViews
from peers.job import Job, Order, run
from peers.opensplat import build_opensplat
from peers.results import Result, Results
from peers.trainers import gsfw_jobs, opensplat_jobs, original_jobs

LEVELS = (20.0, 22.0, 24.0, 26.0, 28.0, 30.0, 31.0)
"""PSNR of the columns of the second table, in dB."""


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m peers", description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, help="a still capture, of any format that gsfw reads")
    parser.add_argument("--out", type=Path, required=True, help="folder of all that is written")
    parser.add_argument("--downscale", type=float, default=1.0, help="images are shrunk by it")
    parser.add_argument("--steps", type=int, nargs="*", default=[300, 1000, 3000])
    parser.add_argument("--minutes", type=float, nargs="*", default=[], help="times, for gsfw only")
    parser.add_argument(
        "--settings", action="append", default=[], help="gsfw once more, with these settings"
    )
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--only", default="", help="trainings whose name has this text")
    parser.add_argument("--opensplat", type=Path, metavar="SOURCE", help="source of OpenSplat")
    parser.add_argument(
        "--original", type=Path, metavar="SOURCE", help="source of the original trainer of 3DGS"
    )
    return parser.parse_args()


def jobs(given: argparse.Namespace, capture: Path) -> list[Job]:
    """All trainings, in turns: those of one length follow one another."""
    order = Order(capture, given.out / "runs", tuple(given.steps))
    found = [
        job
        for settings in ("", *given.settings)
        for job in gsfw_jobs(order, given.minutes, settings)
    ]
    if given.opensplat is not None:
        program = build_opensplat(given.opensplat, given.out / "opensplat")
        found += opensplat_jobs(order, program)
    if given.original is not None:
        found += original_jobs(order, given.original)
    lengths = list(dict.fromkeys(job.length for job in found))
    found.sort(key=lambda job: lengths.index(job.length))
    return [job for job in found if given.only in f"{job.peer}, {job.length}"]


def check_same_bench(given: argparse.Namespace) -> None:
    """Note the work of a bench in its folder.

    Raises:
        DataError: the folder has results of other work.
    """
    names = ("data", "downscale", "threads", "opensplat", "original")
    now = {name: str(value) for name in names if (value := getattr(given, name)) is not None}
    file = given.out / "bench.json"
    before = json.loads(file.read_text()) if file.exists() else {}
    for name in now.keys() & before.keys():
        if now[name] != before[name]:
            raise DataError(
                f"{given.out} holds results with {name}={before[name]}, not {now[name]}.",
                "Choose another folder with --out.",
            )
    file.write_text(json.dumps(before | now))


def main() -> None:
    """Run the bench."""
    given = arguments()
    given.out.mkdir(parents=True, exist_ok=True)
    check_same_bench(given)
    views = HeldOutViews.open(given.data, given.downscale)
    capture = write_training_views(views.data, given.out / "capture")
    results = Results(given.out / "results.jsonl")
    todo = jobs(given, capture.resolve())
    for repeat in range(1, given.repeats + 1):
        for job in (job for job in todo if not results.has(job, repeat)):
            shutil.rmtree(job.folder, ignore_errors=True)
            usage = run(job, given.threads)
            result = Result.of(job, repeat, usage, views.score(job.splats, job.background))
            results.add(result)
            print(
                f"{job.peer}, {job.length}: {result.psnr:.2f} dB, {result.gaussians:,} Gaussians, "
                f"{usage.cpu_seconds:.1f} s CPU, {usage.wall_seconds:.1f} s",
                file=sys.stderr,
            )
    print(f"{results.table()}\n\nCPU seconds to a PSNR:\n\n{results.times_to(LEVELS)}")
    results.draw(given.out / "curves.png", f"{given.data.name}, downscale={given.downscale:g}")


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"{error.message} {error.advice}")
