"""NVRTC's library file: where it is, and what to install where it is missing."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.nvrtc import Nvrtc

MAJORS = (13, 12)
"""Major versions of CUDA to look for where torch does not say which, the best first."""

WINDOWS = sys.platform == "win32"

TOOLKIT = "bin" if WINDOWS else "lib64"
"""Folder of the libraries in a CUDA toolkit."""


def find_nvrtc(cuda: str | None, folders: Sequence[str] | None = None) -> Nvrtc:
    """The compiler of the CUDA that torch was built for.

    Args:
        cuda: what torch was built for, such as "13.0"; ``None`` if it was built without CUDA, then
            any known version will do.
        folders: where Python packages are; by default the interpreter's own search path.

    Raises:
        CudaError: it is not on this machine, or does not load; says what to install.
    """
    majors = [int(cuda.split(".")[0])] if cuda else MAJORS
    broken = []
    for major in majors:
        for candidate in _candidates(major, sys.path if folders is None else folders):
            try:
                return Nvrtc(candidate)
            except CudaError as error:
                if Path(candidate).is_file():
                    broken.append(f"; {error.message}")
    built = f"torch is built for CUDA {cuda}" if cuda else "torch is built without CUDA"
    raise CudaError(
        f"NVRTC {' or '.join(map(str, majors))}, the library that compiles CUDA kernels, was not "
        f"found ({built}){''.join(broken)}.",
        f'pip install "{_distribution(majors[0])}"',
    )


def _distribution(major: int) -> str:
    return "nvidia-cuda-nvrtc-cu12" if major == 12 else f"nvidia-cuda-nvrtc=={major}.*"


def _candidates(major: int, folders: Sequence[str]) -> Iterator[str]:
    """Files to try: what came with torch, then what the system has."""
    name = f"nvrtc64_{major}0_0.dll" if WINDOWS else f"libnvrtc.so.{major}"
    libraries = "bin" if WINDOWS else "lib"
    for folder in folders:
        for place in (
            f"nvidia/cu{major}/{libraries}",
            f"nvidia/cuda_nvrtc/{libraries}",
            "torch/lib",
        ):
            yield from map(str, sorted(Path(folder or ".", place).glob(f"**/{name}")))
    toolkits = [os.environ.get(variable) for variable in ("CUDA_HOME", "CUDA_PATH")]
    environment = Path(sys.prefix, "Library/bin" if WINDOWS else "lib")  # Conda's.
    for path in (environment, *(Path(root, TOOLKIT) for root in toolkits if root)):
        yield str(path / name)
    yield name  # The system's loader may know it, or have it in memory already.
    yield f"/usr/local/cuda/lib64/{name}"
