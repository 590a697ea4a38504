"""The trainers: for each the commands of its trainings, with the trainer's own defaults."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from peers.job import Job, Order

OPENSPLAT_BACKGROUND = (0.6130, 0.0101, 0.3984)
"""model.hpp: the purple of nerfstudio."""


def gsfw_jobs(order: Order, minutes: Sequence[float] = (), settings: str = "") -> list[Job]:
    """Trainings of gsfw: of numbers of steps, and of times.

    All images of the capture are trained on, as held-out ones are not in it; reports are left out,
    as no other trainer writes one.

    Args:
        order: what is asked of every trainer.
        minutes: times.
        settings: instead of gsfw's defaults, as on its command line: "sh=adaptive seed=1".
    """
    lengths = [("gsfw", f"{steps} steps", f"steps={steps}") for steps in order.steps]
    lengths += [("gsfw, minutes=", f"{time:g} min", f"minutes={time:g}") for time in minutes]
    jobs = []
    for name, length, setting in lengths:
        peer = f"{name}, {settings}" if settings else name
        folder = _folder(order, peer, length)
        command = [sys.executable, "-m", "gsfw", "train", "method=3dgs", f"data={order.capture}"]
        command += [setting, "holdout_every=0", "report=false", f"out={folder / 'run'}"]
        command += ["callbacks.tensorboard.enabled=false", *settings.split()]
        jobs.append(Job(peer, length, folder, tuple(command), folder / "run" / "splats.ply"))
    return jobs


def opensplat_jobs(order: Order, program: Path) -> list[Job]:
    """Trainings of OpenSplat: as it comes, and at full size from the first step.

    As it comes it trains on quarter-size images for 3,000 steps and on half-size ones for 3,000
    more, which is meant for large photos.
    """
    ways: tuple[tuple[str, list[str]], ...] = (
        ("OpenSplat", []),
        ("OpenSplat, full size", ["--num-downscales", "0"]),
    )
    jobs = []
    for steps in order.steps:
        for name, further in ways:
            folder = _folder(order, name, f"{steps} steps")
            splats = folder / "splats.ply"
            command = [str(program), str(order.capture), "-n", str(steps), "-o", str(splats)]
            # Without keep-crs the PLY is in a world of OpenSplat's own.
            command += ["--keep-crs", "--cpu", *further]
            job = Job(name, f"{steps} steps", folder, tuple(command), splats, OPENSPLAT_BACKGROUND)
            jobs.append(job)
    return jobs


def original_jobs(order: Order, source: Path) -> list[Job]:
    """Trainings of the original trainer of 3DGS (or a relative of it), on gsfw's CPU engine.

    Raises:
        SystemExit: there is no train.py.
    """
    train = source / "train.py"
    if not train.is_file():
        raise SystemExit(f"{train} is missing. Give the folder of the trainer's own code.")
    jobs = []
    for steps in order.steps:
        folder = _folder(order, "original", f"{steps} steps")
        command = [sys.executable, "-m", "gsfw.compat", "--rasterizer", "cpu", str(train)]
        command += ["-s", str(order.capture), "-m", str(folder), "--iterations", str(steps)]
        # It would evaluate on its way; port 0 is any free one, for its viewer.
        command += ["--test_iterations", "-1", "--port", "0"]
        splats = folder / "point_cloud" / f"iteration_{steps}" / "point_cloud.ply"
        jobs.append(Job("original on our engine", f"{steps} steps", folder, tuple(command), splats))
    return jobs


def _folder(order: Order, name: str, length: str) -> Path:
    """The folder of a run."""
    return order.folder / re.sub(r"[^a-z0-9._]+", "-", f"{name} {length}".lower())
