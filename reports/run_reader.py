"""Run reader: a run's record from its files, without torch; damaged files cost a sentence."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsfw.core.errors import UserError
from gsfw.core.files.json_text import parsed_json
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.config_file import read_config
from gsfw.plugins.settings import Layer
from gsfw.reports.run_log import read_figures
from gsfw.reports.run_record import RunRecord, number
from gsfw.reports.run_state import judge

_EVALUATION = re.compile(r"step_(\d+)\.json")


def read_run(folder: RunFolder, started: float | None = None) -> RunRecord:
    """Read the files of a run; renders nothing and opens no data.

    Args:
        folder: of the run.
        started: its last start in seconds since 1970, if it is remembered.
    """
    problems: list[str] = []
    config = _settings(folder, problems)
    damage = f"{folder.config.name} cannot be read" if config is None else ""
    settings = {} if config is None else config.values
    if config is not None and not settings.get("method"):
        damage = f"{folder.config.name} names no method"
    summary = _document(folder.summary, problems)
    if summary is None:
        damage = damage or f"{folder.summary.name} is not valid JSON"
    log = read_figures(folder.metrics_log, problems)
    latest = None
    try:
        latest = folder.latest_checkpoint()
    except OSError as error:
        damage = damage or f"{folder.checkpoints} cannot be read: {error.strerror}"
    done = [int(step) for line in log if (step := number(line.get("step"))) is not None]
    done += [] if latest is None else [int(latest.stem.split("_")[1])]
    final = _final(summary or {}, settings, max(done, default=None))
    step, evaluation = _evaluation(folder, max(done, default=_steps(final)), problems)
    if step is not None and step < _steps(final) and number(final.get("psnr")) is not None:
        step, evaluation = None, {}  # The last one is lost: the final figures have its means.
    state, why = judge(folder, bool(final), damage)
    return RunRecord(
        folder,
        state,
        why,
        started,
        settings=settings,
        given=_given(config),
        planned=frozenset() if config is None else config.planned,
        log=log,
        steps_done=max(done, default=_steps(final)),
        evaluated_step=step,
        evaluation=evaluation or final,
        summary=final,
        requirements=_document(folder.requirements, problems) or {},
        problems=tuple(problems),
    )


def _given(config: Layer | None) -> frozenset[str]:
    """Keys that the user chose."""
    if config is None:
        return frozenset()
    return (frozenset(config.values) if config.given is None else config.given) - config.planned


def _final(
    summary: Mapping[str, Any], settings: Mapping[str, Any], done: int | None
) -> Mapping[str, Any]:
    """The final figures; empty if the run goes on after an earlier end, or was set back."""
    steps = number(settings.get("steps")) or 0
    is_last = _steps(summary) >= steps and (done is None or done >= steps)
    return summary if is_last else {}


def _steps(summary: Mapping[str, Any]) -> int:
    return int(number(summary.get("steps")) or 0)


def _evaluation(
    folder: RunFolder, done: int, problems: list[str]
) -> tuple[int | None, Mapping[str, Any]]:
    """The latest evaluation until step ``done``, and its step; a damaged one is passed over."""
    steps = {
        int(match[1]): path
        for path in folder.evaluations.glob("step_*.json")
        if (match := _EVALUATION.fullmatch(path.name))
    }
    for step in sorted((step for step in steps if step <= done), reverse=True):
        if found := _document(steps[step], problems):
            return step, found
    return None, {}


def _settings(folder: RunFolder, problems: list[str]) -> Layer | None:
    """Settings and the keys that the user chose; ``None`` if they cannot be read."""
    try:
        return read_config(folder.config, everything=True)
    except UserError as error:
        problems.append(f"{error.message} Settings are left out.")
        return None


def _document(path: Path, problems: list[str]) -> dict[str, Any] | None:
    """An object of a JSON file; empty if it is not there, ``None`` if it is damaged."""
    try:
        found = parsed_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        problems.append(f"{path.name} cannot be read and is left out: {error}.")
        return None
    if not isinstance(found, dict):
        kind = type(found).__name__
        problems.append(f"{path.name} is left out: expected an object, found {kind}.")
        return None
    return found
