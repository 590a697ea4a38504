"""Environment: the place of this process among those of a launcher, without torch.

torchrun and ``gsfw train processes=N`` say it in the same variables.
"""

from __future__ import annotations

import os
import time
from typing import NoReturn

from gsfw.core.errors import ConfigError

LINGER = 10.0
"""Seconds in which the first process can write its message: a launcher ends all processes as soon
as one of them has failed."""


def world() -> int | None:
    """Number of processes that a launcher has started; ``None`` if this one is on its own."""
    is_started = all(name in os.environ for name in ("RANK", "WORLD_SIZE", "MASTER_ADDR"))
    return int(os.environ["WORLD_SIZE"]) if is_started else None


def rank() -> int:
    """Number of this process, from 0."""
    return int(os.environ["RANK"]) if world() is not None else 0


def is_follower() -> bool:
    """True in all processes of a launcher but the first, which alone prints and writes."""
    return rank() > 0


def check_processes(processes: int) -> None:
    """Compare the setting with the processes of a launcher.

    Raises:
        ConfigError: the numbers differ.
    """
    started = world()
    if started is not None and processes != started:
        raise ConfigError(
            f"processes={processes}, but the launcher has started {started}.",
            f"Leave out processes={processes}, or start as many (torchrun --nproc-per-node).",
        )


def patience() -> float:
    """Most minutes of a wait for another process, such as for an evaluation in the first one.

    Raises:
        ConfigError: the variable ``GSFW_PATIENCE`` is no number of minutes.
    """
    text = os.environ.get("GSFW_PATIENCE", "30")
    try:
        minutes = float(text)
    except ValueError:
        minutes = 0.0
    if not 0 < minutes < 1e6:
        raise ConfigError(
            f"GSFW_PATIENCE={text} is no number of minutes.", "Give one above 0, such as 30."
        )
    return minutes


def leave(code: int = 1) -> NoReturn:
    """End a follower without a message: the first process has one, and time to write it."""
    time.sleep(LINGER)
    raise SystemExit(code)
