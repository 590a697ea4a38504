"""Memory trace: a callback that writes the memory of a training every so many steps.

``GSFW_PLUGIN_PATH=campaigns/memory_trace.py`` adds it to a run. ``callbacks.memory_trace.leak``
plants the defect that a leak test has to find.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from gsfw.api import Callback, CallbackConfig, Control, RunInfo, Spec, hookimpl, number
from gsfw.core.machine_memory import anonymous_memory

FILE = "memory_trace.txt"
"""File in the folder of a run: lines of a step and the bytes of ``RssAnon``."""


@hookimpl
def gsfw_callbacks() -> list[Spec]:
    """The trace as a plugin."""
    return [Spec("memory_trace", "writes the memory of a run", f"{__name__}:MemoryTraceConfig")]


@dataclass
class MemoryTraceConfig(CallbackConfig):
    """Writes the memory of a run."""

    every: int = number(100, at_least=1)
    """Steps between two lines."""
    leak: int = number(0, at_least=0)
    """Bytes that are kept at each step: a planted defect."""

    def build(self) -> Callback:
        """Build the callback of one run."""
        return MemoryTrace(self.every, self.leak)


class MemoryTrace(Callback):
    """Writes the anonymous memory of this process, which a control group counts."""

    def __init__(self, every: int, leak: int) -> None:
        self._every, self._leak = every, leak
        self._kept: list[bytes] = []
        self._file: TextIO | None = None

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Open the file of the run."""
        self._file = (run.folder / FILE).open("a", encoding="utf-8", buffering=1)

    def on_tick(self, step: int, control: Control) -> None:
        """Write a line, where one is due."""
        if self._leak:
            self._kept.append(bytes([step % 256]) * self._leak)
        if self._file is not None and step % self._every == 0:
            self._file.write(f"{step} {anonymous_memory()}\n")

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


@dataclass(frozen=True)
class Drift:
    """The growth of memory over the steps of a run after its first part."""

    per_step: float
    """Bytes of a step: the median of slopes, after Theil and Sen."""
    low: float
    """Bytes at the start of that part."""
    high: float
    """Bytes at its end."""


def read_trace(folder: Path) -> NDArray[np.float64]:
    """Steps and bytes of a run: [lines, 2]."""
    return np.loadtxt(folder / FILE, ndmin=2)


def drift(trace: NDArray[np.float64], first: float = 0.5) -> Drift:
    """The drift of memory.

    The slopes are between points that are a tenth of the part apart. Evaluations, which come and
    go, and a heap that keeps two megabytes more after one checkpoint, are in a few of them and do
    not move the median; a leak of steps is in all.

    Args:
        trace: steps and bytes: [lines, 2].
        first: part of the steps that is left out: images are decoded, and the model grows.
    """
    part = trace[trace[:, 0] >= first * trace[-1, 0]]
    apart = max(len(part) // 10, 1)
    later, earlier = part[apart:], part[: len(part) - apart]
    slopes = (later[:, 1] - earlier[:, 1]) / (later[:, 0] - earlier[:, 0])
    tenth = max(len(part) // 10, 1)
    return Drift(
        float(np.median(slopes)),
        float(np.median(part[:tenth, 1])),
        float(np.median(part[-tenth:, 1])),
    )
