"""The file of a checkpoint: written from finite values alone; read without running its code."""

from __future__ import annotations

import pickletools
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gsfw.core.errors import DataError, UserError
from gsfw.core.files.atomic import atomic_file

CHECKPOINT_SCHEMA = 2
"""Version of the checkpoint layout; raised when an older gsfw could not read a newer file."""

MODEL_ALONE = "model_alone"
"""Key of files that have a model without the rest of the state of its run."""

LONGEST_NAME = 1000
"""Characters of a name in a checkpoint's pickle: those of torch have fewer than 100."""
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


def write_checkpoint(path: Path, step: int, state: Mapping[str, Any]) -> None:
    """Write a checkpoint atomically.

    Raises:
        NotFiniteError: a tensor is not finite (nothing is written).
        OutputError: it cannot be written.
    """
    import torch

    check_finite(state)
    with atomic_file(path) as file:
        try:
            torch.save({"schema": CHECKPOINT_SCHEMA, "step": step, **state}, file)
        except RuntimeError as error:
            if isinstance(error.__context__, OSError):  # torch hides that the disk is full.
                raise error.__context__ from None
            raise


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint (tensors and plain data only).

    Raises:
        DataError: it is missing, damaged, or of an unknown layout.
        PermissionError: it may not be read.
    """
    import torch

    try:
        _check_names(path)
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
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
