"""Script: the steps of an edit, in their order, and the file that remembers them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.json_text import parsed_json
from gsfw.editing.editable import Editable
from gsfw.editing.operations.catalogue import OPERATIONS
from gsfw.editing.operations.edit import Edit, Surroundings

FORMAT = "gsfw edits"
"""Mark of files of steps."""
VERSION = 1


@dataclass(frozen=True)
class Step:
    """One edit."""

    name: str
    """Name of the operation."""
    text: str
    """Value of the setting, as text."""
    edit: Edit

    @staticmethod
    def of(name: str, text: str) -> Step:
        """Parse a step.

        Raises:
            ConfigError: its value is wrong.
        """
        operation = OPERATIONS[name]
        try:
            return Step(name, text, operation.parse(text))
        except ValueError as error:
            raise ConfigError(
                f"{name}={text}: {error}.", f"For example: {name}={operation.example}"
            ) from None


@dataclass(frozen=True)
class StepResult:
    """Effect of a step."""

    step: Step
    before: int
    """Number of Gaussians before it."""
    after: int
    note: str
    """Findings besides; empty for none."""

    def __str__(self) -> str:
        """The step in one line."""
        count = f"{self.before:,} -> {self.after:,}"
        count = f"{self.after:,}" if self.before == self.after else count
        note = f" ({self.note})" if self.note else ""
        return f"{self.step.name}: {count} Gaussians{note}"

    def document(self) -> dict[str, Any]:
        """Plain data."""
        found: dict[str, Any] = {
            "edit": self.step.name,
            "value": self.step.text,
            "before": self.before,
            "after": self.after,
        }
        return found | ({"note": self.note} if self.note else {})


def apply(
    steps: Sequence[Step],
    piece: Editable,
    around: Surroundings,
    done: Callable[[StepResult], None],
) -> Editable:
    """Apply steps one after the other.

    Args:
        steps: in their order.
        piece: what is edited.
        around: what edits need besides.
        done: called with the result of each step.

    Raises:
        DataError: nothing is left.
    """
    for step in steps:
        before = len(piece)
        edited = step.edit(piece, around)
        piece = edited.piece
        if len(piece) == 0:
            raise DataError(
                f"{step.name}={step.text} leaves none of the {before:,} Gaussians.",
                _remedy(step.name),
            )
        done(StepResult(step, before, len(piece), edited.note))
    return piece


def _remedy(name: str) -> str:
    """Advice on an operation that leaves nothing."""
    if name in ("crop.box", "crop.sphere", "cut.box", "cut.sphere"):
        return (
            "Values are in the units of the world, as it is after the steps before; "
            "gsfw info FILE says where the Gaussians are."
        )
    return "Leave the step out, or give a value that keeps more of them."


def write_steps(results: Sequence[StepResult], given: str) -> bytes:
    """The content of a file of steps."""
    steps = [result.document() for result in results]
    document = {"format": FORMAT, "version": VERSION, "input": given, "steps": steps}
    return (json.dumps(document, indent=1) + "\n").encode()


def read_steps(path: Path) -> list[Step]:
    """The steps of a file that an edit has written, or a person.

    Raises:
        DataError: it is missing, or no such file.
        ConfigError: a value is wrong.
    """
    try:
        document = parsed_json(path.read_text())
        steps = [(item["edit"], item["value"]) for item in document["steps"]]
        is_ours = document["format"] == FORMAT
    except FileNotFoundError:
        raise DataError(
            f"edits={path}: there is no such file.",
            "Give the path of an .edits.json file that gsfw edit has written, absolute or from "
            f"{Path.cwd()}.",
        ) from None
    except (OSError, ValueError, KeyError, TypeError):
        is_ours, steps = False, []
    if not is_ours or not all(isinstance(text, str) for _, text in steps):
        raise DataError(
            f"edits={path}: this is no file of edits.",
            "Give an .edits.json file that gsfw edit has written.",
        )
    for name, _ in steps:
        if not isinstance(name, str) or name not in OPERATIONS:
            raise DataError(
                f"edits={path}: there is no edit {name!r}.", "All edits: gsfw edit --help"
            )
    return [Step.of(name, text) for name, text in steps]
