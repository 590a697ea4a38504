"""RunFolder: the files of a run; a failed write loses no earlier state."""

from __future__ import annotations

import pickletools
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.core.errors import DataError, OutputError, UserError
from gsfw.core.files.atomic import (
    PARTIAL,
    atomic_file,
    readable_write_errors,
    write_atomically,
)
from gsfw.core.files.json_text import json_text, parsed_json
from gsfw.core.words import shell_argument

if TYPE_CHECKING:
    import torch

CHECKPOINT_SCHEMA = 2
"""Version of the checkpoint layout; raised when an older gsfw could not read a newer file."""

MODEL_ALONE = "model_alone"
"""Key of files that have a model without the rest of the state of its run."""

LONGEST_NAME = 1000
"""Characters of a name in a checkpoint's pickle: those of torch have fewer than 100."""
_STEP = re.compile(r"step_(\d+)\.pt$")
CHECKED_AT_ONCE = 1 << 20
"""Values of a tensor that are checked at once: a check takes twice their memory."""


class NotFiniteError(ValueError):
    """A tensor of a state holds a NaN or an infinity."""


def check_finite(state: object, where: str = "") -> None:
    """Check every floating-point tensor of a nested state.

    Raises:
        NotFiniteError: a tensor holds a NaN or an infinity; names the first such tensor.
    """
    import torch  # Not at the top: gsfw runs lists the files of runs without it.

    if isinstance(state, torch.Tensor):
        parts = state.flatten().split(CHECKED_AT_ONCE) if state.is_floating_point() else ()
        if not all(bool(part.isfinite().all()) for part in parts):
            raise NotFiniteError(f"{where} is not finite")
    elif isinstance(state, Mapping):
        for key, value in state.items():
            check_finite(value, f"{where}.{key}" if where else str(key))
    elif isinstance(state, list | tuple):
        for index, value in enumerate(state):
            check_finite(value, f"{where}[{index}]")


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
        self._write_state(path, step, state)
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
        self._write_state(path, step, {**state, MODEL_ALONE: True})
        return path

    def _model(self, step: int) -> Path:
        return self.checkpoints / f"model_{step:09d}.pt"

    def models_alone(self) -> list[Path]:
        """The models that were written without the rest of their states, by step."""
        return sorted(self.checkpoints.glob("model_*.pt"))

    def _write_state(self, path: Path, step: int, state: Mapping[str, Any]) -> None:
        """Write a state atomically."""
        import torch

        check_finite(state)
        self._check_there()
        with atomic_file(path) as file:
            try:
                torch.save({"schema": CHECKPOINT_SCHEMA, "step": step, **state}, file)
            except RuntimeError as error:
                if isinstance(error.__context__, OSError):  # torch hides that the disk is full.
                    raise error.__context__ from None
                raise

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


def read_checkpoint(path: Path, device: torch.device | str = "cpu") -> dict[str, Any]:
    """Read a checkpoint (tensors and plain data only).

    Raises:
        DataError: it is missing, damaged, or of an unknown layout.
        PermissionError: it may not be read.
    """
    import torch

    try:
        _check_names(path)
        state: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
    except FileNotFoundError:
        raise DataError(f"{path}: there is no such checkpoint.") from None
    except PermissionError:
        raise
    except Exception as error:
        raise DataError(
            f"{path} cannot be read as a checkpoint: {type(error).__name__}.",
            "It may have been cut short in copying; use an earlier one.",
        ) from error
    if isinstance(state, dict) and state.get("schema") == 1:
        state = _upgraded(state)
    if not isinstance(state, dict) or state.get("schema") != CHECKPOINT_SCHEMA:
        found = state.get("schema") if isinstance(state, dict) else type(state).__name__
        raise DataError(
            f"{path}: expected checkpoint schema {CHECKPOINT_SCHEMA}, found {found}.",
            "It was written by another version of gsfw; use that one to read it.",
        )
    if type(state.get("step")) is not int or state["step"] < 0:
        raise DataError(
            f"{path} is a damaged checkpoint: its step is {state.get('step')!r:.60}.",
            "Use an earlier one.",
        )
    return state


@contextmanager
def fitting_state(what: str) -> Iterator[None]:
    """Turn errors of loading a state into a message: its content is not that of the run.

    Args:
        what: the checkpoint, or the folder that it is in.

    Raises:
        DataError: in place of the error.
    """
    import torch

    from gsfw.core.part_state import LOADING_ERRORS, UnfitStateError

    try:
        yield
    except (UserError, torch.OutOfMemoryError):
        raise
    except LOADING_ERRORS as error:
        if isinstance(error, UnfitStateError):
            said, package = str(error), error.package
        else:
            said, package = f"{type(error).__name__}: {error}", ""
        advice = (
            "It is damaged, or of another run; give an earlier one, such as "
            "RUN/checkpoints/step_N.pt."
        )
        if package:
            advice += (
                f" Or {package} has changed since: the run's config.yaml names the version "
                "that trained it."
            )
        problem = " ".join(said.split())[:240].rstrip(".")
        raise DataError(
            f"the checkpoint of {what} does not fit the run: {problem}.", advice
        ) from error


def checkpoint_environment(path: Path) -> dict[str, Any]:
    """The machine of a checkpoint, without its tensors; empty if it cannot be read."""
    import torch

    try:
        _check_names(path)
        state = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
        return dict(state["environment"])
    except Exception:  # It may be damaged in as many ways as there are in a zip and a pickle.
        return {}


def _check_names(path: Path) -> None:
    """Check the lengths of the names in a checkpoint's pickle before torch reads it.

    torch tells of an unknown name by an expression that takes the square of its length: 21 s for
    40,000 characters.

    Raises:
        ValueError: a name is too long, or the pickle is damaged or packed.
        BadZipFile: it is no archive, as torch writes them.
    """
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            if not entry.filename.endswith("/data.pkl"):
                continue
            if entry.compress_type != zipfile.ZIP_STORED:
                raise ValueError("its pickle is packed, as torch does not write it")
            for code, argument, _ in pickletools.genops(archive.read(entry)):
                if code.name == "GLOBAL" and len(str(argument)) > LONGEST_NAME:
                    raise ValueError(f"a name of its pickle has {len(str(argument))} characters")


def _upgraded(state: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a checkpoint of schema 1 (gsfw 0.1.0): its strategy state holds all refiners' states.

    Each refiner takes the state under its own name and ignores the others.
    """
    strategy = dict(state["strategy"])
    budget, guided = strategy.pop("count", {}), strategy.pop("guided", {})
    gathered = {"gathered": strategy, "may_grow": budget.get("stopped") is None}
    refiners = {"budget": budget, "guided": guided, "adc": gathered, "mcmc": gathered}
    others = {key: value for key, value in state.items() if key != "strategy"}
    return {**others, "schema": CHECKPOINT_SCHEMA, "refiners": refiners}
