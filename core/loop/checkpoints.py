"""Checkpoints: the states of a training that are written into the folder of its run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.loop.stopwatch import Stopwatch
from gsfw.core.progress import stage

if TYPE_CHECKING:
    from gsfw.core.loop.trainer import Trainer


class Checkpoints:
    """Writes the checkpoints of one training."""

    def __init__(self, stopwatch: Stopwatch) -> None:
        """Nothing is written yet; ``stopwatch`` times the steps of the training."""
        self._stopwatch = stopwatch
        self._updates = -1

    def are_current(self, trainer: Trainer) -> bool:
        """True if no update has followed the latest checkpoint."""
        return self._updates == trainer.walk.updates

    def loaded(self, trainer: Trainer) -> None:
        """Note that the training has the state of a checkpoint."""
        self._updates = trainer.walk.updates

    def write(self, trainer: Trainer) -> None:
        """Write a checkpoint, in the processes that take part.

        Raises:
            OutputError: it cannot be written; earlier checkpoints are untouched.
        """
        trainer.catch_up()
        if not trainer.parts.team.evaluates:
            return
        self._updates = trainer.walk.updates
        state = trainer.parts.team.whole(trainer.state_dict(), trainer.parts, trainer.folder.path)
        if state is None:
            return
        with stage("writing a checkpoint"), trainer.walk.apart():
            path = trainer.folder.write_checkpoint(trainer.step, state)
            release_freed_memory()  # That of writing, which steps do not need.
        trainer.control.checkpoint_requested = False
        with self._stopwatch.paused():
            trainer.callbacks.on_checkpoint(trainer.step, path)

    def keep(self, trainer: Trainer, together: bool = False) -> None:
        """Write a checkpoint in place of further steps, if none has changed a part of the state.

        Views that an unfinished step has drawn count as seen.

        Args:
            trainer: of the run.
            together: true if all processes of the team do so between the same two steps.
        """
        is_whole = (together or trainer.parts.team.size == 1) and not trainer.updates.is_underway
        if is_whole and not self.are_current(trainer):
            self.write(trainer)
