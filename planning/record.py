"""Record: plan.json and config.yaml of a planned run, with all that was decided.

``config.yaml`` repeats the run bit for bit on any machine: its steps, its choices and every change
of its pace are settings. ``plan.json`` says besides what was asked for and measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import parsed_json
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.planning.plan import Plan
from gsfw.plugins.config_file import write_config
from gsfw.plugins.settings import Settings


def plan_document(plan: Plan) -> dict[str, Any]:
    """Facts of a run before it trains, as plain data."""
    return {
        "minutes": plan.asked.minutes,
        "until": plan.asked.until,
        "measured": plan.speed.document(),
        "decided": dict(plan.decided),
    }


def read_plan(folder: RunFolder) -> dict[str, Any]:
    """The record in a folder; empty if there is none, or if it is damaged."""
    try:
        document = parsed_json(folder.plan.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


@contextmanager
def recorded(
    trainer: Trainer, settings: Settings, command: Sequence[str], document: Mapping[str, Any]
) -> Iterator[None]:
    """Write both files when training begins, and with all decisions when it has ended.

    Args:
        trainer: of the run; it has a timekeeper.
        settings: of the run.
        command: the command line, for people.
        document: what was known before the run trained.

    Raises:
        OutputError: a file cannot be written.
    """
    trainer.folder.write_json(trainer.folder.plan, dict(document))
    try:
        yield
    finally:
        if trainer.folder.config.is_file():
            _write(trainer, settings, command, document)


def _write(
    trainer: Trainer, settings: Settings, command: Sequence[str], document: Mapping[str, Any]
) -> None:
    walk, folder = trainer.walk, trainer.folder
    assert walk.timekeeper is not None
    pace = walk.pace.texts
    walked: dict[str, Any] = {
        "pace": [*pace],
        "steps": trainer.step,
        "updates": walk.updates,
        "seconds": round(walk.timekeeper.spent(), 3),
    }
    if walk.goal is not None:
        walked |= walk.goal.state_dict()
    folder.write_json(folder.plan, {**document, **walked})
    given, planned = (
        tuple(dict.fromkeys([*keys, "pace"])) for keys in (settings.given, settings.planned)
    )
    config = replace(settings.config, pace=pace)
    recorded = replace(settings, config=config, given=given, planned=planned)
    write_atomically(folder.config, write_config(recorded, command).encode())
