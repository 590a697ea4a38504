"""Gsplat: one version of the package, whose kernels are compiled while other parts run."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpu_package import install_wheels
from gpu_process import Process

LIMIT_SECONDS = 240.0
"""For compiling it."""

BUILD = """
from gsplat.cuda._backend import _C
if _C is None:
    raise SystemExit("gsplat found no CUDA toolkit (nvcc) to compile its kernels with")
"""


class Gsplat:
    """A wheel of gsplat in a folder of its own, so that several versions can be compared."""

    def __init__(
        self,
        wheel: Path,
        work: Path,
        environment: Mapping[str, str],
        machine: Mapping[str, Any],
        together: int,
    ) -> None:
        """Install a wheel and begin to compile.

        Args:
            wheel: of any version.
            work: folder for everything.
            environment: of processes.
            machine: with the ``capability`` of its GPU.
            together: versions that are compiled at once, and share the cores.
        """
        found = re.match(r"gsplat-([^-]+)-", wheel.name)
        self.version = found[1] if found else wheel.stem
        site = work / f"gsplat-{self.version}"
        jobs = max(1, (os.cpu_count() or 1) // (together + 1))
        self.environment = dict(environment) | {
            "PYTHONPATH": os.pathsep.join([str(site), environment["PYTHONPATH"]]),
            "TORCH_EXTENSIONS_DIR": str(work / f"gsplat-{self.version}-build"),
            "TORCH_CUDA_ARCH_LIST": str(machine["capability"]),
            "MAX_JOBS": str(jobs),
        }
        self.problem = install_wheels([wheel], site)
        if not self.problem and shutil.which("ninja", path=environment["PATH"]) is None:
            self.problem = "ninja is not there to compile it with"
        self._process: Process | None = None
        if not self.problem:
            name = f"gsplat-{self.version}-build"
            self._process = Process(name, [sys.executable, "-c", BUILD], self.environment, work)

    def wait(self, seconds: float) -> float:
        """Wait until it can be used, or ``problem`` says why not; the seconds that it took."""
        if self._process is None:
            return 0.0
        ended = self._process.wait(min(seconds, LIMIT_SECONDS - self._process.seconds))
        self._process, self.problem = None, ended.problem
        return ended.seconds
