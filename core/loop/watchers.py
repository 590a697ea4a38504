"""Watchers: the callbacks of a run; the failure of one does not end the run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxtyping import UInt8
from torch import Tensor

from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport
from gsfw.core.errors import UserError

if TYPE_CHECKING:
    from gsfw.core.loop.evaluation import Evaluation
    from gsfw.core.loop.requirements import Requirements

logger = logging.getLogger("gsfw.run")


class Watchers(Callback):
    """Forwards events to every callback of a run; detaches one that raises, and logs that once.

    A ``UserError`` (the disk is full, for instance) is for the user: it ends the run.
    """

    def __init__(self, callbacks: Sequence[Callback] = ()) -> None:
        self._callbacks = list(callbacks)

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Forward the start of the run."""
        self._tell("on_start", lambda callback: callback.on_start(run, control))

    def on_step(self, report: StepReport, control: Control) -> None:
        """Forward a logged step."""
        self._tell("on_step", lambda callback: callback.on_step(report, control))

    def on_tick(self, step: int, control: Control) -> None:
        """Forward a step."""
        self._tell("on_tick", lambda callback: callback.on_tick(step, control))

    def on_view(self, step: int, view: EvaluatedView) -> None:
        """Forward a held-out image of an evaluation."""
        self._tell("on_view", lambda callback: callback.on_view(step, view))

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Forward an evaluation."""
        self._tell(
            "on_evaluation", lambda callback: callback.on_evaluation(step, evaluation, control)
        )

    def on_checkpoint(self, step: int, path: Path) -> None:
        """Forward a checkpoint that is safely on disk."""
        self._tell("on_checkpoint", lambda callback: callback.on_checkpoint(step, path))

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Forward the end of the run."""
        self._tell("on_end", lambda callback: callback.on_end(step, summary))

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """Forward the requirements of a completed run."""
        self._tell("on_requirements", lambda callback: callback.on_requirements(requirements, plot))

    def close(self) -> None:
        """Close all callbacks, the first one last; an error of one does not keep others open."""
        with ExitStack() as stack:
            for callback in self._callbacks:
                stack.callback(self._call, callback, "close", lambda closing: closing.close())

    def _tell(self, event: str, call: Callable[[Callback], None]) -> None:
        for callback in tuple(self._callbacks):
            self._call(callback, event, call)

    def _call(self, callback: Callback, event: str, call: Callable[[Callback], None]) -> None:
        try:
            call(callback)
        except UserError:
            raise
        except Exception as error:
            self._callbacks.remove(callback)
            logger.warning(
                "%s failed in %s and is switched off; the run continues: %s: %s",
                callback.origin or f"callback {type(callback).__name__}",
                event,
                type(error).__name__,
                error,
                exc_info=True,
            )
            if event != "close":  # It may hold files or the screen.
                with suppress(Exception):
                    callback.close()
