"""RunRecord: what the files of a run say of it, read without building anything."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import yaml

from gsfw.core.files.folder_lock import Owner, holder
from gsfw.core.loop.run_folder import RunFolder

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The same content ten times faster, where PyYAML was built with libyaml."""

_EVALUATION = re.compile(r"step_\d+\.json")


class State(Enum):
    """What can be done with a run."""

    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    RUNNING = "running"
    DAMAGED = "damaged"


@dataclass(frozen=True)
class RunRecord:
    """One run, for lists."""

    path: Path
    state: State
    scene: str
    method: str
    started: float | None
    """Last start in seconds since 1970; ``None`` if it is not remembered."""
    steps: int
    """Steps of the whole run; 0 if unknown."""
    steps_done: int
    psnr: float | None
    """Held-out PSNR of the latest evaluation in dB; ``None`` if there is none."""
    gaussians: int | None
    train_seconds: float | None
    why: str = ""
    """Why it is damaged, or who trains it; else empty."""

    def document(self) -> dict[str, Any]:
        """Plain data for programs."""
        return {**asdict(self), "path": str(self.path), "state": self.state.value}


def read_record(path: Path, started: float | None = None) -> RunRecord:
    """Read what the files of a run say; damaged ones cost their figures only.

    Args:
        path: folder of the run.
        started: its last start in seconds since 1970, if it is remembered.
    """
    folder = RunFolder(path)
    settings, problem = _settings(folder)
    summary = _json(folder.summary)
    log = _last_logged(folder)
    steps = _number(settings.get("steps"))
    done = max(_number(summary.get("steps")), log.steps, _last_checkpoint_step(folder))
    state, why = _state(folder, problem, steps, summary, holder(path))
    psnr = summary.get("psnr") if state is State.FINISHED else _evaluated_psnr(folder)
    return RunRecord(
        path,
        state,
        scene=str(summary.get("scene") or _scene(settings)),
        method=str(settings.get("method") or summary.get("method") or "?"),
        started=started,
        steps=steps,
        steps_done=done,
        psnr=float(psnr) if isinstance(psnr, int | float) else None,
        gaussians=summary.get("num_gaussians", log.gaussians)
        if state is State.FINISHED
        else log.gaussians,
        train_seconds=summary.get("train_seconds", log.seconds)
        if state is State.FINISHED
        else log.seconds,
        why=why,
    )


def _state(
    folder: RunFolder, problem: str, steps: int, summary: Mapping[str, Any], owner: Owner | None
) -> tuple[State, str]:
    """The state of a run, and why it is damaged or who trains it."""
    if owner is not None:
        return State.RUNNING, str(owner)
    if problem:
        return State.DAMAGED, problem
    latest = folder.latest_checkpoint()
    is_finished = bool(summary) and _number(summary.get("steps")) >= steps
    if folder.summary.exists() and not summary:
        return State.DAMAGED, f"{folder.summary.name} is not valid JSON"
    if latest is None and not is_finished:
        return State.DAMAGED, "it has no checkpoint: nothing was trained"
    if latest is not None and not zipfile.is_zipfile(latest):
        return State.DAMAGED, f"{latest.name} is cut short or is no checkpoint"
    return (State.FINISHED if is_finished else State.INTERRUPTED), ""


def _settings(folder: RunFolder) -> tuple[Mapping[str, Any], str]:
    """The settings of a run, and what is wrong with their file."""
    try:
        document = yaml.load(folder.config.read_text(encoding="utf-8"), LOADER)
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return {}, f"{folder.config.name} cannot be read"
    if not isinstance(document, dict) or not document.get("method"):
        return {}, f"{folder.config.name} names no method"
    return document, ""


def _scene(settings: Mapping[str, Any]) -> str:
    """The name of the data: of its folder, or of the built-in scene."""
    data = str(settings.get("data") or "")
    return Path(data).name if data else str(settings.get("datamanager") or "?")


def _json(path: Path) -> Mapping[str, Any]:
    """An object of a JSON file; empty if there is none."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def _number(value: object) -> int:
    return int(value) if isinstance(value, int | float) and math.isfinite(value) else 0


def _last_checkpoint_step(folder: RunFolder) -> int:
    latest = folder.latest_checkpoint()
    return 0 if latest is None else int(latest.stem.split("_")[1])


def _evaluated_psnr(folder: RunFolder) -> float | None:
    """PSNR of the latest evaluation of the held-out views."""
    found = [path for path in folder.evaluations.glob("*.json") if _EVALUATION.fullmatch(path.name)]
    psnr = _json(max(found)).get("psnr") if found else None
    return psnr if isinstance(psnr, float) else None


@dataclass(frozen=True)
class _Logged:
    """The end of a run's metrics.jsonl."""

    steps: int = 0
    gaussians: int | None = None
    seconds: float | None = None
    """Sum over the logged steps."""


def _last_logged(folder: RunFolder) -> _Logged:
    steps, gaussians, seconds = 0, None, None
    for line in _lines(folder.metrics_log):
        if _number(line.get("step")) and isinstance(line.get("step_ms"), int | float):
            seconds = (seconds or 0.0) + line["step_ms"] * (line["step"] - steps) / 1e3
            steps, gaussians = line["step"], line.get("num_gaussians")
    return _Logged(steps, gaussians, seconds)


def _lines(path: Path) -> Iterator[Mapping[str, Any]]:
    """The lines of a log, up to one that is cut short."""
    try:
        texts = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return
    for text in texts:
        try:
            line = json.loads(text)
        except ValueError:
            return
        yield line
