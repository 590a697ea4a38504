"""Settings of the built-in callbacks, ``callbacks.NAME.KEY=VALUE``; light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.core.config import CallbackConfig
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.core.callback import Callback


@dataclass
class AutosaveConfig(CallbackConfig):
    """Checkpoints by the clock, besides those of checkpoint_every."""

    minutes: float = number(15.0, above=0)
    """Age of the latest checkpoint at which another is written."""

    def build(self) -> Callback:
        """Build the callback."""
        from gsfw.callbacks.autosave import Autosave

        return Autosave(60.0 * self.minutes)


@dataclass
class LogConfig(CallbackConfig):
    """log.txt."""

    every: int = number(10, at_least=1)
    """Logged steps between two lines."""

    def build(self) -> Callback:
        """Build the callback."""
        from gsfw.callbacks.log import Log

        return Log(self.every)


@dataclass
class ProgressConfig(CallbackConfig):
    """The progress line."""

    seconds: float = number(8.0, at_least=0)
    """Seconds between two plain lines without a terminal."""

    def build(self) -> Callback:
        """Build the callback."""
        from gsfw.callbacks.progress import Progress

        return Progress(self.seconds)


@dataclass
class ResultsConfig(CallbackConfig):
    """metrics.jsonl, metrics.json and eval/."""

    def build(self) -> Callback:
        """Build the callback."""
        from gsfw.callbacks.results import Results

        return Results()


@dataclass
class TensorBoardConfig(CallbackConfig):
    """TensorBoard events."""

    images: int = number(4, at_least=0)
    """Held-out views shown per evaluation; more make event files large and pages slow."""

    def build(self) -> Callback:
        """Build the callback."""
        from gsfw.callbacks.tensorboard import TensorBoard

        return TensorBoard(self.images)
