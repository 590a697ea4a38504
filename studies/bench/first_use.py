"""First use: from starting Python to the first picture, before and after kernels were compiled."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

from gsfw.core.errors import UnavailableError
from gsfw.kernels.cuda.cache import FOLDER

CHILD = """
import json, sys, time
began = time.perf_counter()
import torch
device = torch.device(sys.argv[2])
(torch.zeros(1, device=device) + 1).item()
imported = time.perf_counter()
from gsfw.studies.bench.entrants import choose
from gsfw.studies.bench.scene import scattered
from gsfw.plugins.registry import installed
_, candidates = choose([sys.argv[1]], sys.argv[2], installed())
(candidate,) = candidates.values()
splats, cameras = scattered(1000, 640, 420, device)
splats = splats.map(lambda tensor: tensor.requires_grad_())
ready = time.perf_counter()
output = candidate.rasterizer.render(splats, cameras, candidate.settings)
output.color.sum().item()
drawn = time.perf_counter()
output.color.sum().backward()
splats.means.grad.sum().item()
seconds = [imported - began, ready - imported, drawn - ready, time.perf_counter() - drawn]
names = ["torch", "gsfw", "first_picture", "first_backward"]
print(json.dumps({f"{name}_seconds": round(took, 3) for name, took in zip(names, seconds)}))
"""
"""Runs in a process of its own, since what is measured happens once in each."""

LIMIT_SECONDS = 120.0


def first_use(rasterizer: str, device: str) -> dict[str, dict[str, float]]:
    """Seconds of each part with an empty cache of kernels, and with what that has left there.

    ``torch`` is importing it and touching the device; ``gsfw`` is importing it and building the
    rasterizer and a small scene; then come the first picture of a process, and its backward pass.

    Raises:
        UnavailableError: the process fails; says how.
    """
    with tempfile.TemporaryDirectory(prefix="gsfw-bench-") as cache:
        environment = os.environ | {FOLDER: cache}
        return {state: _child([rasterizer, device], environment) for state in ("cold", "warm")}


def _child(arguments: list[str], environment: dict[str, str]) -> dict[str, float]:
    command = [sys.executable, "-c", CHILD, *arguments]
    try:
        ended = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LIMIT_SECONDS,
            check=True,
        )
    except subprocess.CalledProcessError as error:
        reason = (error.stderr or "").strip().rpartition("\n")[2]
        raise UnavailableError(
            f"a new process did not draw with rasterizer {arguments[0]}: {reason}",
            "Leave first_use out, or see gsfw doctor.",
        ) from None
    except subprocess.TimeoutExpired:
        raise UnavailableError(
            f"a new process did not draw with rasterizer {arguments[0]} within "
            f"{LIMIT_SECONDS:.0f} s.",
            "Leave first_use out, or see gsfw doctor.",
        ) from None
    result: dict[str, float] = json.loads(ended.stdout.strip().rpartition("\n")[2])
    return result
