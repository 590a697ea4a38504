"""A stand-in for ``gsfw train`` and ``gsfw resume``: leaves the files of a run at once.

Some seeds stand for what can go wrong; no torch is loaded, so that tests of studies are quick.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

REFUSED, KILLED, WAITS_FOR_ANOTHER, INTERRUPTS, DISK_FULL, TORN, HUNG_UP = range(13, 20)
"""Seeds of runs that fail, are killed, wait until two are at work, or interrupt their study; that
find the disk full, leave half a result, or are ended by SIGHUP."""

SECONDS = 20
"""After which a run that waits for something gives up."""


def main(verb: str, *arguments: str) -> int:
    """Make a run."""
    if verb == "resume":
        out = Path(arguments[0])
        given = json.loads((out / "given.json").read_text())
        (out / "resumed").write_text(" ".join(arguments))
    else:
        given = dict(item.split("=", 1) for item in arguments)
        out = Path(given["out"])
        out.mkdir(parents=True)
        (out / "given.json").write_text(json.dumps(given))
        (out / "config.yaml").write_text(f"data: '{given.get('data', '')}'\n")
    return train(out, given, int(given["seed"]), verb == "resume")


def train(out: Path, given: dict[str, str], seed: int, resumed: bool) -> int:
    """Do what the seed stands for."""
    if seed == REFUSED and not (out.parent / "allowed").exists():
        sys.stdout.write(json.dumps({"error": "this seed is refused.", "advice": "Take another."}))
        return 2
    if seed == DISK_FULL:
        sys.stderr.write("note: something\nno space is left\n")
        return 1
    if seed == KILLED and not resumed:
        checkpoint(out)
        os.kill(os.getpid(), signal.SIGKILL)
    if seed == WAITS_FOR_ANOTHER:
        meet(out)
    if seed == INTERRUPTS and not resumed:
        wait_to_be_stopped(out)
        return 130
    if seed == HUNG_UP:
        return 128 + signal.SIGHUP
    finish(out, given, seed)
    if seed == TORN:
        (out / "metrics.json").write_text('{"psnr": 20')
    return 0


def checkpoint(out: Path) -> None:
    """Something to go on from."""
    (out / "checkpoints").mkdir()
    (out / "checkpoints" / "step_000000005.pt").touch()


def meet(out: Path) -> None:
    """Wait until another run is at work."""
    place = out.parents[1]
    for _ in range(SECONDS * 20):
        if len(list(place.glob("*/seed-*/given.json"))) > 1:
            (out / "threads").write_text(os.environ["OMP_NUM_THREADS"])
            return
        time.sleep(0.05)
    sys.exit("no other run came")


def wait_to_be_stopped(out: Path) -> None:
    """Press Ctrl-C on the study, and leave a checkpoint when it asks for that."""
    asked: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: asked.append(number))
    os.kill(os.getppid(), signal.SIGINT)
    for _ in range(SECONDS * 20):
        if asked:
            checkpoint(out)
            return
        time.sleep(0.05)


def finish(out: Path, given: dict[str, str], seed: int) -> None:
    """Leave a result: its PSNR tells methods and seeds apart."""
    for path in out.glob("checkpoints/*"):
        path.unlink()
    bonus = {"3dgs": 0.0, "4dgs": 5.0, "spacetime": 5.1}[given["method"]]
    summary = {
        "method": given["method"],
        "completed": True,
        "psnr": 20 + bonus + seed / 100,
        "ssim": 0.5,
        "steps": int(given["steps"]),
        "train_seconds": 2.0,
        "num_gaussians": 1000,
        "render_ms": 1.5,
        "over_time": [{"psnr": 20.0}],
        "peak_memory_mb": {"rss": 400.0},
        "protocol": {"checkpoint": "last", "views": 2, "image_sizes": [[32, 24]]},
    }
    (out / "metrics.json").write_text(json.dumps(summary))


if __name__ == "__main__":
    sys.exit(main(*[item for item in sys.argv[1:] if item != "json=true"]))
