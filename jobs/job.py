"""Job: a command line of gsfw or a call of a function, and what it needs of a machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Resources:
    """Resources of a machine that one job takes."""

    cpus: float | None = None
    """Cores, which are also its threads; ``None`` leaves them to the executor."""
    gpus: float | None = None
    """GPUs; 0.5 lets two jobs share one. ``None`` leaves them to the executor."""
    memory: int = 0
    """Bytes of main memory; 0 where that is not known."""


@dataclass(frozen=True)
class Call:
    """A call of a function that other processes can import, with arguments that can be pickled."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Job:
    """Work that one process does; an executor runs it."""

    name: str
    """Name for people."""
    work: tuple[str, ...] | Call
    """Arguments of ``gsfw``, such as ``("train", "data=scene", "out=runs/first")``; or a call."""
    resources: Resources = field(default_factory=Resources)
    reads: tuple[Path, ...] = ()
    """Files and folders that have to be at the same paths on the machine that does the work."""
    folder: Path | None = None
    """The folder that it writes, which the arguments name by this very path; ``None`` for none.
    A machine that does not see it works in a folder of its own, which is then brought here."""
    resume: tuple[str, ...] = ()
    """Arguments of ``gsfw`` where the folder holds a checkpoint. Empty, or without a checkpoint:
    the folder is removed, and the work begins anew."""
    result: Path | None = None
    """A file in the folder, without which the work has not finished; ``None`` for none."""
