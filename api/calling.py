"""Calling: the program that calls gsfw, while a run trains or is evaluated for it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from gsfw.commands.interface.caller import Caller
from gsfw.commands.interface.console import Console, LoggedWarnings, ProgramConsole
from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import installed

if TYPE_CHECKING:
    from gsfw.core.callback import Callback
    from gsfw.core.loop.trainer import Trainer

ALONE = threading.RLock()
"""Held while a run trains or is evaluated: both change settings of torch that all threads share."""


@contextmanager
def calling(callbacks: Sequence[Callback], progress: bool) -> Iterator[Caller]:
    """The program that calls gsfw, alone; warnings and slow stages are printed if it wants that.

    Raises:
        ConfigError: a callback is none.
    """
    from gsfw.commands.interface.progress import SlowStages
    from gsfw.core.callback import Callback
    from gsfw.core.progress import shown_by

    watching = tuple(callbacks) if isinstance(callbacks, Iterable) else None
    if watching is None or not all(isinstance(callback, Callback) for callback in watching):
        raise ConfigError(
            f"callbacks={callbacks!r}: expected a list of gsfw.api.Callback.",
            "Derive from it, and give an object of your class: callbacks=[MyCallback()]",
        )
    console = ProgramConsole(is_quiet=not progress)
    with ALONE, ExitStack() as stack:
        if progress:
            stack.enter_context(shown_by(SlowStages().stage))
        if progress and not logging.getLogger().handlers:  # A program with some prints them itself.
            stack.enter_context(LoggedWarnings(console).shown())
        for broken in installed().broken:
            console.warn(str(broken))
        yield Caller(console, _train_in_program, watching, progress)


def _train_in_program(trainer: Trainer, console: Console) -> int:
    """Train to the end, or until Ctrl-C; the exit code."""
    from gsfw.commands.interface.failure import INTERRUPTED
    from gsfw.commands.interface.interrupt import stop_on_signal, unclaimed_signals
    from gsfw.commands.interface.training import train_to_end

    with stop_on_signal(trainer.control, unclaimed_signals()) as interrupt:
        summary = train_to_end(trainer, console)
    return INTERRUPTED if interrupt.received and not summary["completed"] else 0
