"""A stand-in for ``gsfw train`` whose figures follow from its settings, for tests of tradeoffs."""

import json
import os
import signal
import sys
from pathlib import Path

GAUSSIANS = 1000
"""Of a run that nothing limits."""

KILLED = 13
"""Seed of a run that is killed, unless a file beside its folder allows it to go on."""


def main(verb: str, *arguments: str) -> int:
    """Make a run."""
    given = dict(item.split("=", 1) for item in arguments)
    out = Path(given["out"])
    out.mkdir(parents=True)
    if int(given["seed"]) == KILLED and not (out.parents[2] / "allowed").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    steps, degree = int(given["steps"]), int(given.get("sh_degree", 3))
    budget = given.get("strategy.budget", "none")
    count = min(GAUSSIANS, int(budget)) if budget.isdigit() else GAUSSIANS
    size = count * 4 * (11 + 3 * (degree + 1) ** 2)
    summary = {
        "completed": True,
        "psnr": 20 + steps / 100 + 0.1 * degree + count / 1000 + (int(given["seed"]) - 42) / 50,
        "ssim": 0.5,
        "steps": steps,
        "train_seconds": steps / 100,
        "num_gaussians": count,
        "render_ms": 1.5,
        "model_bytes": size,
        "peak_memory_mb": 400.0,
        "protocol": {},
    }
    (out / "splats.ply").write_bytes(b"\0" * size)
    (out / "metrics.json").write_text(json.dumps(summary))
    with (out.parents[2] / "made.txt").open("a") as file:
        file.write(f"{out.name}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(*[item for item in sys.argv[1:] if item != "json=true"]))
