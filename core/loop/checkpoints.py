"""Checkpoints: the states of a training that are written into the folder of its run.

A part of a plugin may get a state that no checkpoint can hold after any step. It is looked for
between checkpoints, too, and ends the training; the model is then written without the rest.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import torch

from gsfw.core.errors import (
    ConfigError,
    LostProcessError,
    NotEnoughMemoryError,
    OutputError,
    SilentProcessError,
    TrainingError,
    UserError,
)
from gsfw.core.loop.checkpoint_file import NotFiniteError
from gsfw.core.loop.determinism import environment
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.loop.stopwatch import Stopwatch
from gsfw.core.part_state import state_of
from gsfw.core.progress import stage
from gsfw.core.team import Team
from gsfw.core.words import shell_argument

if TYPE_CHECKING:
    from gsfw.core.loop.trainer import Trainer

Made = TypeVar("Made")

logger = logging.getLogger("gsfw.run")

CHECKED_AGAIN = 1.1
"""Steps at the next check of the states, over those at the last one. A check took 4 to 90 us with
the parts of gsfw after 20 steps, and 36 ms with a part that has four values for each of 5,000 views
(two busy cores): too much for each logged step."""
FINITE = "Tensors in state_dict have to be finite; plain numbers may be infinite."


class Checkpoints:
    """Writes the checkpoints of one training."""

    def __init__(self, stopwatch: Stopwatch) -> None:
        """Nothing is written yet; ``stopwatch`` times the steps of the training."""
        self._stopwatch = stopwatch
        self._updates = -1
        self._checked = 0

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
            TrainingError: no checkpoint can hold the state; the model is written without it.
            ConfigError: the same before the first update.
        """
        trainer.catch_up()
        if not trainer.parts.team.evaluates:
            return
        with self._model_kept(trainer):
            own = _in_all(trainer.parts.team, trainer.state_dict)
        state = trainer.parts.team.whole(own, trainer.parts, trainer.folder.path)
        self._updates = trainer.walk.updates
        if state is None:
            return
        with stage("writing a checkpoint"), trainer.walk.apart(), self._model_kept(trainer, state):
            path = trainer.folder.write_checkpoint(trainer.step, state)
            release_freed_memory()  # That of writing, which steps do not need.
        trainer.control.checkpoint_requested = False
        with self._stopwatch.paused():
            trainer.callbacks.on_checkpoint(trainer.step, path)

    def keep(self, trainer: Trainer, together: bool = False) -> None:
        """Write a checkpoint in place of further steps, if none has changed a part of the state.

        Views that an unfinished step has drawn count as seen. Of processes that share the rendering
        none has the whole state.

        Args:
            trainer: of the run.
            together: true if all processes of the team do so between the same two steps.
        """
        team = trainer.parts.team
        is_whole = together or team.size == 1 or not team.shares_rendering
        if is_whole and not trainer.updates.is_underway and not self.are_current(trainer):
            self.write(trainer)

    def keep_after(self, error: Exception, trainer: Trainer) -> None:
        """Write a checkpoint when an error ends the training, such as a bug of a plugin; say so.

        An error of the state, of memory or of the disk would only come again. Processes that share
        the rendering write together, as long as all of them run.
        """
        team, is_lost = trainer.parts.team, isinstance(error, LostProcessError)
        again = isinstance(error, (TrainingError, NotEnoughMemoryError, OutputError))
        has_state = (not again or is_lost) and trainer.walk.updates > 0
        if not team.evaluates:
            return
        with suppress(Exception):  # The first error is the one to report.
            # A process that cannot read the folder still has to meet the others.
            before = trainer.folder.latest_checkpoint() if team.leads else None
            if not team.shares_rendering:
                if has_state:
                    self.keep(trainer)
            elif not isinstance(error, SilentProcessError):
                self._keep_together(trainer, has_state and not trainer.updates.is_underway)
            kept = trainer.folder.latest_checkpoint() if team.leads else None
            if kept != before:
                logger.warning(
                    "%s has the state after %d steps: %sgsfw resume %s continues from there",
                    *(kept, trainer.step),
                    "" if is_lost else "once the error below is corrected, ",
                    shell_argument(trainer.folder.path),
                )

    def _keep_together(self, trainer: Trainer, has_state: bool) -> None:
        """Write a checkpoint if all processes stand after the same step; every one calls this."""
        team = trainer.parts.team
        standing = (trainer.step, trainer.walk.updates, trainer.parts.table.row_edits)
        try:
            if not team.meets_again(standing if has_state else None):
                return
            if not team.gathered(self.are_current(trainer))[0]:
                self.write(trainer)
            _wait_for_first(team)
        except LostProcessError:
            if team.leads:
                logger.warning(
                    "the steps after %s are lost with the Gaussians of another process",
                    trainer.folder.latest_checkpoint(),
                )

    def check(self, trainer: Trainer) -> None:
        """Check, ever more rarely, that a checkpoint can hold the states of the parts as they are.

        Tensors are not read.

        Raises:
            TrainingError: none can; the model is written without them.
        """
        if trainer.step < CHECKED_AGAIN * self._checked or not trainer.parts.team.evaluates:
            return
        self._checked = trainer.step
        parts = trainer.parts
        with self._stopwatch.paused(), self._model_kept(trainer):
            checked = (parts.sampler, parts.method, *parts.refiners)
            _in_all(parts.team, lambda: [state_of(part) for part in checked])

    @contextmanager
    def _model_kept(
        self, trainer: Trainer, whole: Mapping[str, Any] | None = None
    ) -> Iterator[None]:
        """Write the model alone if the state cannot be taken or written.

        Args:
            trainer: of the run.
            whole: the state with the rows of all processes, if they have been collected.

        Raises:
            TrainingError: in place of a message on the state; the first process has the message.
            LostProcessError: another process has ended, or does not answer.
        """
        try:
            yield
        except (OutputError, torch.OutOfMemoryError):
            raise
        except Exception as error:
            if isinstance(error, LostProcessError) and not isinstance(error, _OtherStateError):
                raise  # The state may be sound; its other rows are out of reach.
            if trainer.walk.updates == 0:  # Nothing is lost.
                if isinstance(error, NotFiniteError):
                    raise ConfigError(f"{error}.", FINITE) from None
                raise
            self._updates = trainer.walk.updates  # Another attempt would fail, too.
            model = self._write_model(trainer, whole)
            if isinstance(error, UserError):
                problem, advice = error.message, error.advice
            elif isinstance(error, NotFiniteError):
                problem, advice = f"{error}.", FINITE
            else:  # A bug, which is reported as one.
                if model is not None:
                    logger.warning("%s has the model after %d steps", model, trainer.step)
                raise
            if not trainer.parts.team.leads:
                raise LostProcessError("the first process has ended this training.") from None
            raise TrainingError(
                f"no checkpoint can be written after {trainer.step} steps: {problem}",
                _advice(trainer, advice, model),
            ) from None

    def _write_model(self, trainer: Trainer, whole: Mapping[str, Any] | None) -> Path | None:
        """Write the model without the rest of the state; the path, or ``None`` if that fails."""
        parts, path = trainer.parts, None
        with suppress(UserError, NotFiniteError, torch.OutOfMemoryError):
            state = whole
            if state is None:
                details = parts.rasterizer.capabilities().details
                own = {
                    "model": state_of(parts.model),
                    "corrections": dict(parts.corrections.state_dict()),
                    "environment": environment(parts.device, details),
                }
                state = parts.team.whole(own, parts, trainer.folder.path)
            if state is not None:
                kept = {key: state[key] for key in ("model", "corrections", "environment")}
                path = trainer.folder.write_model(trainer.step, kept)
            if whole is None:
                _wait_for_first(parts.team)
        return path


class _OtherStateError(LostProcessError):
    """The state of another process cannot be made; the first process has its text."""


def _wait_for_first(team: Team) -> None:
    """Wait until the first process has written: a launcher ends all when another one ends."""
    if team.shares_rendering:
        team.gathered(None)


def _in_all(team: Team, make: Callable[[], Made]) -> Made:
    """Make a part of the state; of processes that share the rendering, all fail if one does.

    Raises:
        Exception: that of making it.
        TrainingError: another process has failed; the first process has its text.
        LostProcessError: another process has ended, or does not answer.
    """
    try:
        made = make()
    except Exception as error:
        if team.shares_rendering:
            team.gathered(str(error) or type(error).__name__)
        raise
    texts = team.gathered("") if team.shares_rendering else []
    for number, text in enumerate(texts):
        if text:
            raise (TrainingError if team.leads else _OtherStateError)(f"process {number}: {text}")
    return made


def _advice(trainer: Trainer, advice: str, model: Path | None) -> str:
    """The remedy, and the files that are kept."""
    lines = [advice] if advice else []
    if model is not None:
        lines.append(
            f"{model} has the model after {trainer.step} steps: gsfw view {shell_argument(model)}"
        )
    kept = trainer.folder.latest_checkpoint()
    if kept is not None:
        run = shell_argument(trainer.folder.path)
        lines.append(
            f"{kept} is kept: once that is corrected, gsfw resume {run} continues from there."
        )
    return "\n".join(lines)
