"""Caller: the program that trains, a verb or Python code of a user; light to import."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.commands.interface.console import Console
from gsfw.core.config import replace_at
from gsfw.plugins.loading import make_callbacks

if TYPE_CHECKING:
    from gsfw.core.callback import Callback
    from gsfw.core.loop.trainer import Trainer
    from gsfw.plugins.registry import Registry
    from gsfw.plugins.settings import Settings


@dataclass(frozen=True)
class Caller:
    """The program that trains."""

    console: Console
    run: Callable[[Trainer, Console], int]
    """Trains to the end, or until a signal; the exit code. ``run_training``, for a verb."""
    callbacks: Sequence[Callback] = ()
    """Callbacks besides those of the settings."""
    shows_progress: bool = True
    """False to leave out the progress line, whatever the settings."""

    def callbacks_of(self, settings: Settings, registry: Registry) -> list[Callback]:
        """Build all callbacks of a run."""
        configs = settings.config.callbacks
        if not self.shows_progress:
            configs = replace_at(configs, "progress.enabled", False)
        return [*make_callbacks(configs, registry), *self.callbacks]
