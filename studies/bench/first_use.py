"""First use: seconds from the start of Python to the first image, with and without a cache."""

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
from gsfw.studies.bench.workload import scattered
from gsfw.studies.entrants import entrant_of
from gsfw.plugins.registry import installed
entrant = entrant_of(sys.argv[1], installed(), device)
splats, cameras = scattered(1000, 640, 420, device)
splats = splats.map(lambda tensor: tensor.requires_grad_())
ready = time.perf_counter()
output = entrant.rasterizer.render(splats, cameras, entrant.settings)
output.color.sum().item()
rendered = time.perf_counter()
output.color.sum().backward()
splats.means.grad.sum().item()
seconds = [imported - began, ready - imported, rendered - ready, time.perf_counter() - rendered]
names = ["torch", "gsfw", "first_image", "first_backward"]
print(json.dumps({f"{name}_seconds": round(took, 3) for name, took in zip(names, seconds)}))
"""
"""Runs in a process of its own: everything it measures happens once in a process."""

LIMIT_SECONDS = 120.0


def first_use(rasterizer: str, device: str) -> dict[str, dict[str, float]]:
    """Seconds of each part with an empty cache of kernels (cold) and with a filled one (warm).

    ``torch``: importing it and touching the device; ``gsfw``: importing it, building the rasterizer
    (which, cold, tests the GPU with kernels that it compiles for that) and a small scene;
    ``first_image`` and ``first_backward``: rendering and its backward pass.

    Raises:
        UnavailableError: the process fails; says why.
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
            f"a new process did not render with rasterizer {arguments[0]}: {reason}",
            "Leave first_use out, or see gsfw doctor.",
        ) from None
    except subprocess.TimeoutExpired:
        raise UnavailableError(
            f"a new process did not render with rasterizer {arguments[0]} within "
            f"{LIMIT_SECONDS:.0f} s.",
            "Leave first_use out, or see gsfw doctor.",
        ) from None
    result: dict[str, float] = json.loads(ended.stdout.strip().rpartition("\n")[2])
    return result
