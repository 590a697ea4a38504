"""RunRecord: what the files of a run say of it, for lists, comparisons and pages."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from gsfw.core.loop.checkpoint_file import checkpoint_environment
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shown_metrics
from gsfw.plugins.config_file import read_header
from gsfw.reports.run_log import Messages, read_messages
from gsfw.reports.run_state import State

LOGGED = {"num_gaussians": "num_gaussians", "train_seconds": "seconds"}
"""Figures that the log has too, for runs without final figures."""


@dataclass(frozen=True)
class RunRecord:
    """The facts of a run's folder; made by ``gsfw.reports.run_reader``."""

    folder: RunFolder
    state: State
    why: str = ""
    """Cause of damage, or the process that trains it; else empty."""
    started: float | None = None
    """Last start in seconds since 1970; ``None`` if it is not remembered."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Every setting, by dotted key; empty if they cannot be read."""
    given: frozenset[str] = frozenset()
    """Keys that the user chose."""
    planned: frozenset[str] = frozenset()
    """Keys that were decided for the time or the quality that the user asked for."""
    log: tuple[Mapping[str, Any], ...] = ()
    """Figures of the logged steps and of the evaluations, in order."""
    steps_done: int = 0
    """Steps that are done, by the log and the latest checkpoint."""
    evaluated_step: int | None = None
    """Step of the latest evaluation; ``None`` if there is none."""
    evaluation: Mapping[str, Any] = field(default_factory=dict)
    """The latest evaluation on held-out views, or the final figures; empty without both."""
    summary: Mapping[str, Any] = field(default_factory=dict)
    """The final figures; empty for an unfinished run, also if it was finished earlier."""
    requirements: Mapping[str, Any] = field(default_factory=dict)
    """requirements.json; empty if it is not there."""
    problems: tuple[str, ...] = ()
    """Files that cannot be read, a sentence each."""

    @property
    def path(self) -> Path:
        """Folder of the run."""
        return self.folder.path

    @property
    def name(self) -> str:
        """Short name: the last two folders."""
        return "/".join(self.path.resolve().parts[-2:])

    @property
    def steps(self) -> int:
        """Length of the run by its settings; 0 if unknown."""
        found = self.settings.get("steps", 0)
        return found if isinstance(found, int) else 0

    @property
    def is_finished(self) -> bool:
        """True if the final figures are those of its last step."""
        return bool(self.summary)

    @property
    def method(self) -> str:
        """Name of the method."""
        return str(self.settings.get("method") or self.summary.get("method") or "?")

    @property
    def data(self) -> str:
        """Name of the data set without its place, or of the datamanager of a built-in scene."""
        data = str(self.settings.get("data") or "")
        return Path(data).name if data else str(self.settings.get("datamanager") or "?")

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return str(self.summary.get("scene") or self.data)

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Measurement protocol of the figures; empty if nothing was evaluated."""
        found = self.evaluation.get("protocol") or self.summary.get("protocol")
        return found if isinstance(found, Mapping) else {}

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics of held-out views worth a row, also those of plugins, in order."""
        found = dict.fromkeys(name for view in self.per_view for name in view)
        names = shown_metrics(found, self.protocol)
        return [name for name in names if number(self.evaluation.get(name)) is not None]

    def figure(self, name: str) -> float | None:
        """A figure of the latest evaluation, of the end or of the log; ``None`` if unknown."""
        for source in (self.evaluation, self.summary):
            found = number(source.get(name))
            if found is not None:
                return found
        return self._logged.get(LOGGED.get(name, ""))

    def baseline(self, name: str) -> float | None:
        """PSNR of an image that needs no model; ``None`` if it was not measured."""
        found = self.evaluation.get("baselines")
        return number(found.get(name)) if isinstance(found, Mapping) else None

    @cached_property
    def _logged(self) -> Mapping[str, float]:
        """The last number of Gaussians, and the seconds of all logged steps."""
        steps = 0.0
        found: dict[str, float] = {}
        for line in self.log:
            step, each = number(line.get("step")), number(line.get("step_ms"))
            if step and each is not None:
                found["seconds"] = found.get("seconds", 0.0) + each * (step - steps) / 1e3
                steps = step
            if (count := number(line.get("num_gaussians"))) is not None:
                found["num_gaussians"] = count
        return found

    @property
    def per_view(self) -> list[Mapping[str, Any]]:
        """Figures of each compared view, the worst PSNR first; those without one last."""
        views = [
            {**item, "name": str(item["name"])}
            for item in listed(self.evaluation, "per_view")
            if "name" in item
        ]
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

    @cached_property
    def header(self) -> Mapping[str, Any]:
        """Versions, plugins and the command line of the start; empty if they cannot be read."""
        return read_header(self.folder.config) if self.settings else {}

    @cached_property
    def environment(self) -> Mapping[str, Any]:
        """Machine of the latest checkpoint; empty if there is none. Imports torch."""
        latest = self.folder.latest_checkpoint()
        return {} if latest is None else checkpoint_environment(latest)

    @cached_property
    def messages(self) -> Messages:
        """Notes and warnings of its log."""
        return read_messages(self.folder.log)

    def document(self) -> dict[str, Any]:
        """Plain data for programs."""
        count = self.figure("num_gaussians")
        return {
            "path": str(self.path),
            "state": self.state.value,
            "scene": self.scene,
            "method": self.method,
            "started": self.started,
            "steps": self.steps,
            "steps_done": self.steps_done,
            "psnr": self.figure("psnr"),
            "gaussians": None if count is None else int(count),
            "train_seconds": self.figure("train_seconds"),
            "why": self.why,
        }


def number(value: object) -> float | None:
    """A finite number; ``None`` for all else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) else None


def listed(document: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """The objects in a list of a document; anything else is left out."""
    found = document.get(key)
    return [item for item in found if isinstance(item, Mapping)] if isinstance(found, list) else []


def _or_last(value: float | None) -> float:
    return math.inf if value is None else value
