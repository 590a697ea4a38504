"""RunFolder: the files of a run; a failed write loses no earlier state."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import PARTIAL, readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text, parsed_json
from gsfw.core.loop.checkpoint_file import MODEL_ALONE, write_checkpoint
from gsfw.core.words import shell_argument

_STEP = re.compile(r"step_(\d+)\.pt$")


class RunFolder:
    """The files of one run; see "State of a run" in the architecture notes of the README."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._is_watched = False

    @property
    def config(self) -> Path:
        """Every setting, as plain data."""
        return self.path / "config.yaml"

    @property
    def metrics_log(self) -> Path:
        """One line of JSON per logged step."""
        return self.path / "metrics.jsonl"

    @property
    def summary(self) -> Path:
        """The final figures."""
        return self.path / "metrics.json"

    @property
    def requirements(self) -> Path:
        """The floats of the final model, and the PSNR gain of each group."""
        return self.path / "requirements.json"

    @property
    def requirements_plot(self) -> Path:
        """The same as an image."""
        return self.path / "requirements.png"

    @property
    def report(self) -> Path:
        """One page of all of it, to look at and to send."""
        return self.path / "report.html"

    @property
    def plan(self) -> Path:
        """Measurements and decisions of a run with minutes= or until=."""
        return self.path / "plan.json"

    @property
    def log(self) -> Path:
        """Log messages and tracebacks."""
        return self.path / "log.txt"

    @property
    def tensorboard(self) -> Path:
        """Event files."""
        return self.path / "tb"

    @property
    def evaluations(self) -> Path:
        """Per-view figures of each evaluation."""
        return self.path / "eval"

    @property
    def splats(self) -> Path:
        """The final model as a 3DGS PLY, in the world of the data."""
        return self.path / "splats.ply"

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints, step_N.pt."""
        return self.path / "checkpoints"

    def checkpoint(self, step: int) -> Path:
        """Path of the checkpoint after ``step`` steps."""
        return self.checkpoints / f"step_{step:09d}.pt"

    def latest_checkpoint(self) -> Path | None:
        """The checkpoint with the most steps; ``None`` when there is none."""
        return next(iter(self.all_checkpoints()[::-1]), None)

    def all_checkpoints(self) -> list[Path]:
        """All checkpoints, by step.

        Raises:
            PermissionError: the folder may not be read.
        """
        found: list[Path] = []
        with suppress(FileNotFoundError, NotADirectoryError):
            found = [path for path in self.checkpoints.iterdir() if _STEP.fullmatch(path.name)]
        return sorted(found, key=lambda path: path.name)

    def write_json(self, path: Path, document: object) -> None:
        """Write plain data atomically."""
        write_atomically(path, (json_text(document, indent=1) + "\n").encode())

    def write_checkpoint(self, step: int, state: Mapping[str, Any], keep: int = 2) -> Path:
        """Write a checkpoint atomically; keep only the last ``keep``.

        Later ones are deleted: they belong to a run before its resume from an earlier step.

        Raises:
            NotFiniteError: a tensor is not finite (nothing is written).
            OutputError: it cannot be written; earlier checkpoints are untouched.
        """
        path = self.checkpoint(step)
        self._check_there()
        write_checkpoint(path, step, state)
        kept = [other for other in self.all_checkpoints() if other.name <= path.name][-keep:]
        partial = self.checkpoints.glob(f".step_*{PARTIAL}")  # Of a process that was killed.
        passed = [other for other in self.models_alone() if other <= self._model(step)]
        for other in (*self.all_checkpoints(), *partial, *passed):
            if other not in kept:
                other.unlink(missing_ok=True)
        return path

    def write_model(self, step: int, state: Mapping[str, Any]) -> Path:
        """Write the model of a run whose state no checkpoint can hold, atomically.

        It opens as a checkpoint does, and training cannot continue from it. It is deleted once a
        checkpoint after as many steps is written.

        Raises:
            NotFiniteError: a tensor is not finite (nothing is written).
            OutputError: it cannot be written.
        """
        path = self._model(step)
        self._check_there()
        write_checkpoint(path, step, {**state, MODEL_ALONE: True})
        return path

    def _model(self, step: int) -> Path:
        return self.checkpoints / f"model_{step:09d}.pt"

    def models_alone(self) -> list[Path]:
        """The models that were written without the rest of their states, by step."""
        return sorted(self.checkpoints.glob("model_*.pt"))

    @property
    def is_finished(self) -> bool:
        """True if a completed run has written all of its files."""
        return self.summary.is_file() and not self.unfinished.exists()

    @property
    def unfinished(self) -> Path:
        """Empty file that is there until a completed run has written all of its files."""
        return self.path / ".unfinished"

    @contextmanager
    def written_to(self, is_whole: Callable[[], bool] = lambda: True) -> Iterator[None]:
        """Note that files are missing until the end of the block; after an error too.

        Args:
            is_whole: returns false, at the end of the block, if a signal has left out files.

        Raises:
            OutputError: nothing can be written, or the folder is gone in the meantime.
        """
        write_atomically(self.unfinished, b"")
        self._is_watched = True
        try:
            yield
            self._check_there()
        finally:
            self._is_watched = False
        if is_whole():
            with readable_write_errors(self.path):
                self.unfinished.unlink()

    def _check_there(self) -> None:
        """Refuse to write where the disk of the run was before it was unmounted.

        Raises:
            OutputError: the folder of the run is gone.
        """
        if self._is_watched and not self.unfinished.exists():
            raise OutputError(
                f"{self.path} is gone: it was removed, or its disk is no longer there.",
                f"Bring the disk back, and continue with gsfw resume {shell_argument(self.path)}.",
            )

    def cut_metrics_log(self, step: int, is_evaluated_again: bool) -> None:
        """Drop logged lines after ``step``, and a line truncated by a crash.

        Args:
            step: last one that is kept.
            is_evaluated_again: true to drop the evaluation of that step, too.
        """
        if not self.metrics_log.is_file():
            return
        kept: list[str] = []
        for line in self.metrics_log.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                document = parsed_json(line)
                is_later = document["step"] > step
            except (ValueError, TypeError, KeyError):
                break
            if is_later:
                break
            if document["step"] < step or "loss" in document or not is_evaluated_again:
                kept.append(line)
        write_atomically(self.metrics_log, "".join(f"{line}\n" for line in kept).encode())
