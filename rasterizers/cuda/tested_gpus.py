"""Tested GPUs: each passes the self-test once, before the first image is rendered on it.

What has passed is remembered on disk under a key of all that the result depends on; a fault is not,
so that it is looked for again by the next process.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

import torch

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.kernels.cuda.cache import cache_folder, cache_key
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.source_files import SHARED, SOURCES
from gsfw.rasterizers.cuda.self_test import SelfTest, self_test

logger = logging.getLogger(__name__)

DRIVER_VERSION = Path("/sys/module/nvidia/version")
"""Linux has the version of NVIDIA's kernel module here; the driver itself tells CUDA's alone."""

CODE = (SOURCES.parent, SHARED, Path(__file__).parent)
"""Folders of all code between a call of the rasterizer and the GPU."""

ADVICE = (
    "Use rasterizer=gsplat if it is installed, or device=cpu; gsfw doctor repeats the test, and "
    "rasterizer.self_test=false renders without it."
)


def check_gpu(device: torch.device) -> None:
    """Test a GPU, unless it is known to have passed; at most once per process.

    Raises:
        CudaError: it does not pass; says what differs, and what to use instead.
    """
    _check(torch.cuda.current_device() if device.index is None else device.index)


@cache  # An error is not kept.
def _check(index: int) -> None:
    if _record(index).is_file():
        return
    found = examine(index)
    if found.fault:
        raise CudaError(
            f"rasterizer cuda does not pass its self-test on {gpu_name(index)}: {found.fault}.",
            ADVICE,
        )
    logger.info("self-test of %s: %s", gpu_name(index), found)


def examine(index: int) -> SelfTest:
    """Test a GPU, and remember that it has passed."""
    device, record = torch.device("cuda", index), _record(index)
    found = self_test(cuda_launcher(device), device)
    if found.fault:
        record.unlink(missing_ok=True)
    else:
        with suppress(OutputError, OSError):  # The next process tests it again.
            line = f"{gpu_name(index)} {found}, {time.strftime('%Y-%m-%d')}\n"
            write_atomically(record, line.encode())
    return found


def gpu_name(index: int) -> str:
    """Name and number of a GPU: "NVIDIA H100 (cuda:0)"."""
    return f"{torch.cuda.get_device_name(index)} (cuda:{index})"


def _record(index: int) -> Path:
    """The file that exists once the GPU has passed."""
    return cache_folder() / f"{cache_key(_identity(index))}.tested"


def _identity(index: int) -> Iterator[str]:
    """The GPU, its driver, torch, and our code: the result depends on nothing else."""
    properties = torch.cuda.get_device_properties(index)
    yield properties.name
    yield str(getattr(properties, "uuid", index))  # torch 2.5 and newer have it.
    yield DRIVER_VERSION.read_text().strip() if DRIVER_VERSION.is_file() else ""
    yield "{}.{}".format(*cuda_launcher(torch.device("cuda", index)).driver.version)
    yield torch.__version__
    yield from _code()


@cache
def _code() -> tuple[str, ...]:
    """Every file of our code, with its name."""
    files = [
        path
        for folder in CODE
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".py", ".cu", ".h")
    ]
    return tuple(text for path in files for text in (path.name, path.read_text(encoding="utf-8")))
