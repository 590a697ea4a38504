"""RunRecord: what the files of a run say; damaged ones are left out with a sentence."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from gsfw.core.errors import UserError
from gsfw.core.loop.run_folder import RunFolder, checkpoint_environment
from gsfw.plugins.config_file import HEADER, read_config

MOST_WARNINGS = 20
"""Most warnings of a log that are shown, the latest ones."""

_EVALUATION = re.compile(r"step_(\d+)\.json$")
_LOGGED = re.compile(r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d+ (WARNING|ERROR|INFO) (.*)$")


@dataclass(frozen=True)
class RunRecord:
    """The facts of a run's folder."""

    folder: RunFolder
    settings: Mapping[str, Any]
    """Every setting, by dotted key; empty if they cannot be read."""
    given: frozenset[str]
    """Keys that the user chose."""
    header: Mapping[str, Any]
    """Versions, plugins and the command line of the start."""
    log: tuple[Mapping[str, Any], ...]
    """Figures of the logged steps and of the evaluations, in order."""
    evaluations: Mapping[int, Mapping[str, Any]]
    """Evaluations on held-out views, by step."""
    summary: Mapping[str, Any]
    """The final figures; empty for an unfinished run."""
    requirements: Mapping[str, Any]
    """requirements.json; empty if it is not there."""
    environment: Mapping[str, Any]
    """Machine of the latest checkpoint; empty if there is none."""
    notes: tuple[str, ...] = ()
    """Notes that the run began with."""
    warnings: tuple[str, ...] = ()
    """Warnings and errors of its log, the latest ones."""
    problems: tuple[str, ...] = ()
    """Files that cannot be read, a sentence each."""
    steps_done: int = 0
    """By its log and its latest checkpoint."""
    protocol: Mapping[str, Any] = field(default_factory=dict)
    """Measurement protocol of the latest evaluation."""

    @property
    def name(self) -> str:
        """Short name: the last two folders."""
        return "/".join(self.folder.path.resolve().parts[-2:])

    @property
    def steps(self) -> int:
        """Length of the run by its settings; 0 if unknown."""
        found = self.settings.get("steps", 0)
        return found if isinstance(found, int) else 0

    @property
    def is_finished(self) -> bool:
        """True if the run has written its final figures."""
        return bool(self.summary) and (not self.steps or self.steps_done >= self.steps)

    @property
    def method(self) -> str:
        """Name of the method."""
        return str(self.settings.get("method", self.summary.get("method", "unknown")))

    @property
    def scene(self) -> str:
        """Name of the scene."""
        data = str(self.settings.get("data") or "")
        return str(self.summary.get("scene") or Path(data).name or "built-in scene")

    @property
    def evaluated_step(self) -> int | None:
        """Step of the latest evaluation; ``None`` if there is none."""
        return max((step for step in self.evaluations if step <= self.steps_done), default=None)

    @property
    def evaluation(self) -> Mapping[str, Any]:
        """The latest evaluation, or the final figures; empty if there are none."""
        step = self.evaluated_step
        return self._final if step is None else self.evaluations[step]

    @property
    def _final(self) -> Mapping[str, Any]:
        """Figures of the end; empty if the run goes on after an earlier end."""
        return self.summary if self.is_finished else {}

    def figure(self, name: str) -> float | None:
        """A figure of the latest evaluation or of the end; ``None`` if it is not known."""
        for source in (self.evaluation, self._final):
            found = number(source.get(name))
            if found is not None:
                return found
        return None

    def last(self, name: str) -> float | None:
        """The last logged figure of a name; ``None`` if it was never logged."""
        return next((value for line in self.log[::-1] if (value := number(line.get(name)))), None)

    @property
    def num_gaussians(self) -> float | None:
        """At the end, or when last logged; ``None`` if it is not known."""
        return self.figure("num_gaussians") or self.last("num_gaussians")

    @property
    def per_view(self) -> list[Mapping[str, Any]]:
        """Figures of each compared view, the worst PSNR first; those without one last."""
        views = [item for item in listed(self.evaluation, "per_view") if "name" in item]
        return sorted(views, key=lambda view: _or_last(number(view.get("psnr"))))

    def series(self, name: str) -> list[tuple[float, float]]:
        """The logged values of a figure, as (step, value)."""
        points = []
        for line in self.log:
            step, value = number(line.get("step")), number(line.get(name))
            if step is not None and value is not None:
                points.append((step, value))
        return points

    @property
    def findings(self) -> list[Mapping[str, Any]]:
        """Signs that the result is not sound."""
        return listed(self.evaluation, "findings")


def number(value: object) -> float | None:
    """A finite number; ``None`` for all else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _or_last(value: float | None) -> float:
    return math.inf if value is None else value


def listed(document: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """The objects of a list in a file; empty if it is not there."""
    found = document.get(key)
    return [item for item in found if isinstance(item, dict)] if isinstance(found, list) else []


def read_run(folder: RunFolder) -> RunRecord:
    """Read the files of a run; renders nothing and opens no data."""
    problems: list[str] = []
    settings, given, header = _settings(folder, problems)
    summary = _document(folder.summary, problems)
    log = _metrics_log(folder.metrics_log, problems)
    evaluations = {
        int(match[1]): document
        for path in sorted(folder.evaluations.glob("step_*.json"))
        if (match := _EVALUATION.fullmatch(path.name)) and (document := _document(path, problems))
    }
    notes, warnings = _messages(folder.log)
    latest = folder.latest_checkpoint()
    steps = [int(step) for line in log if (step := number(line.get("step"))) is not None]
    done = max([0, *steps, *([int(latest.stem.split("_")[1])] if latest else [])])
    newest = evaluations.get(max((step for step in evaluations if step <= done), default=-1), {})
    protocol = newest.get("protocol") or summary.get("protocol")
    return RunRecord(
        folder=folder,
        settings=settings,
        given=given,
        header=header,
        log=log,
        evaluations=evaluations,
        summary=summary,
        requirements=_document(folder.requirements, problems),
        environment={} if latest is None else checkpoint_environment(latest),
        notes=notes,
        warnings=warnings,
        problems=tuple(problems),
        steps_done=done,
        protocol=protocol if isinstance(protocol, dict) else {},
    )


def _settings(
    folder: RunFolder, problems: list[str]
) -> tuple[Mapping[str, Any], frozenset[str], Mapping[str, Any]]:
    """Settings, the keys that the user chose, and the origin of the run."""
    try:
        layer = read_config(folder.config, everything=True)
        document = yaml.safe_load(folder.config.read_text(encoding="utf-8")) or {}
    except UserError as error:
        problems.append(f"{error.message} Settings are left out.")
        return {}, frozenset(), {}
    given = frozenset(layer.values) if layer.given is None else layer.given
    header = {key: document[key] for key in HEADER if key in document and key != "schema"}
    return layer.values, given, header


def _document(path: Path, problems: list[str]) -> dict[str, Any]:
    """An object of a JSON file; empty if it is not there or damaged."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        problems.append(f"{path.name} cannot be read and is left out: {error}.")
        return {}
    if not isinstance(found, dict):
        kind = type(found).__name__
        problems.append(f"{path.name} is left out: expected an object, found {kind}.")
        return {}
    return found


def _metrics_log(path: Path, problems: list[str]) -> tuple[Mapping[str, Any], ...]:
    """The lines of the log of figures, up to the first damaged one."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ()
    found: list[Mapping[str, Any]] = []
    for place, line in enumerate(lines, start=1):
        try:
            document = json.loads(line)
        except ValueError:
            document = None
        if not isinstance(document, dict):
            problems.append(f"{path.name} is damaged at line {place}: the curves end before it.")
            break
        found.append(document)
    return tuple(found)


def _messages(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Notes, and warnings and errors, of a log; each once."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return (), ()
    matches = [match for line in lines if (match := _LOGGED.match(line))]
    notes = [m[2].removeprefix("note: ") for m in matches if m[2].startswith("note: ")]
    warnings = [m[2] for m in matches if m[1] != "INFO"]
    return tuple(dict.fromkeys(notes)), tuple(dict.fromkeys(warnings))[-MOST_WARNINGS:]
