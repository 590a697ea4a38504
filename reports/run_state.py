"""State of a run: finished, interrupted, running or damaged, by its files."""

from __future__ import annotations

import os
import zipfile
from enum import Enum

from gsfw.core.files.folder_lock import holder
from gsfw.core.loop.run_folder import RunFolder


class State(Enum):
    """The states of a run, which say what can be done with it."""

    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    RUNNING = "running"
    DAMAGED = "damaged"


def judge(folder: RunFolder, is_finished: bool, damage: str) -> tuple[State, str]:
    """The state of a run, and the cause of damage or the process that trains it.

    Args:
        folder: of the run.
        is_finished: true if its final figures are those of its last step.
        damage: a file without which it cannot go on, and what is wrong with it; else empty.
    """
    owner = holder(folder.path)
    if owner is not None:
        return State.RUNNING, str(owner)
    if damage:
        return State.DAMAGED, damage
    latest = folder.latest_checkpoint()
    if latest is None and not is_finished:
        return State.DAMAGED, "it has no checkpoint: nothing was trained"
    if latest is not None and not os.access(latest, os.R_OK):
        return State.DAMAGED, f"{latest.name} cannot be read: check its permissions"
    if latest is not None and not zipfile.is_zipfile(latest):
        return State.DAMAGED, f"{latest.name} is cut short or is no checkpoint"
    return (State.FINISHED if is_finished else State.INTERRUPTED), ""
