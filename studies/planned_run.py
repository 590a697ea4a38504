"""PlannedRun: a cell of a study with its resolved settings, its folder and its progress."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gsfw.core.errors import ConfigError, UserError
from gsfw.core.files.json_text import json_text
from gsfw.core.loop.run_folder import RunFolder
from gsfw.jobs.job import Job, Resources
from gsfw.planning.asked import BOUND, LENGTHS
from gsfw.plugins.compose import check
from gsfw.plugins.config_file import read_config
from gsfw.plugins.keys import keys
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Layer, Settings, resolve
from gsfw.plugins.values import as_text, plain
from gsfw.studies.study import NEUTRAL, Cell, slug

DIGITS = 10
"""Length of a fingerprint: enough to tell the runs of any study apart."""


@dataclass(frozen=True)
class PlannedRun:
    """A run of a study, ready to start."""

    cell: Cell
    data: Path | None
    """Path of its data; ``None`` for the built-in scene."""
    settings: Mapping[str, Any]
    """Every value that the result depends on, by dotted key; ``data`` as the study has it."""
    folder: RunFolder
    chosen: frozenset[str] = frozenset()
    """Keys whose values in the study differ from their defaults."""

    @property
    def fingerprint(self) -> str:
        """Short hash of the settings."""
        return fingerprint(self.settings)

    def comparable(self, stored: Mapping[str, Any]) -> dict[str, Any]:
        """The settings that have to equal those of a stored result.

        A setting that gsfw did not have yet when the result was made counts only where the study
        gives it another value: its default should mean the earlier behaviour.

        Args:
            stored: settings of the result.
        """
        known = self.chosen | stored.keys()
        return {key: value for key, value in self.settings.items() if key in known}

    @property
    def steps(self) -> int:
        """Number of training steps."""
        return int(self.settings["steps"])

    @property
    def limit(self) -> float | None:
        """Seconds in which it ends; ``None`` for a run of a number of steps."""
        minutes, until = float(self.settings.get("minutes") or 0), self.settings.get("until")
        return 60 * (minutes or BOUND) if minutes or until else None

    def arguments(self) -> list[str]:
        """Arguments of ``gsfw train``."""
        given = dict(self.cell.settings)
        if self.data is not None:
            given["data"] = self.data
        if not given.keys() & {"minutes", "until", *LENGTHS}:  # A study compares equal lengths.
            given["steps"] = self.steps
        return [
            *(f"{key}={as_text(value)}" for key, value in given.items()),
            f"out={self.folder.path}",
        ]

    def job(self, resources: Resources) -> Job:
        """The job that makes it or goes on with it.

        Raises:
            ConfigError: the settings beside its checkpoint are damaged.
        """
        resume = ["resume", str(self.folder.path)]
        if self.steps_done() is not None:
            before = read_config(self.folder.config, everything=True).values.get("data")
            if self.data is not None and str(self.data.resolve()) != before:
                resume.append(f"data={self.data}")  # It has moved.
        return Job(
            self.cell.name,
            ("train", *self.arguments()),
            resources,
            reads=() if self.data is None else (self.data,),
            folder=self.folder.path,
            resume=tuple(resume),
            result=self.folder.summary,
        )

    def is_finished(self) -> bool:
        """True if its folder holds a complete result."""
        return self.folder.is_finished

    def steps_done(self) -> int | None:
        """Steps of its last checkpoint; ``None`` where it cannot be resumed."""
        checkpoint = self.folder.latest_checkpoint()
        if checkpoint is None or not self.folder.config.is_file():
            return None
        return int(checkpoint.stem.rpartition("_")[2])


def fingerprint(settings: Mapping[str, Any]) -> str:
    """A short hash of settings."""
    text = json_text(dict(sorted(settings.items())))
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def data_path(cell: Cell, root: Path) -> Path | None:
    """Path of a cell's data; ``None`` for the built-in scene."""
    written = cell.settings.get("data")
    return (root / Path(str(written)).expanduser()).absolute() if written else None


def is_missing(cell: Cell, root: Path) -> bool:
    """True if a cell's data is missing."""
    path = data_path(cell, root)
    return path is not None and not path.exists()


def plan_runs(
    cells: Sequence[Cell], registry: Registry, root: Path, folder: Path
) -> list[PlannedRun]:
    """Resolve and check the settings of runs whose data exists.

    Args:
        cells: of the study.
        registry: everything installed.
        root: where relative data paths begin.
        folder: of the study.

    Raises:
        ConfigError: a setting of any of them is wrong; names the row and the scene.
    """
    return [_planned(cell, registry, root, folder) for cell in cells]


def _planned(cell: Cell, registry: Registry, root: Path, folder: Path) -> PlannedRun:
    data = data_path(cell, root)
    given = dict(cell.settings)
    if data is not None:
        given["data"] = str(data)
    source = f"row {cell.row!r} on scene {cell.scene!r}"
    try:
        resolved = resolve(registry, [Layer(source, given)])
        check(resolved, registry)
    except UserError as error:
        message = error.message.removeprefix(f"{source}: ")
        raise ConfigError(f"{source}: {message}", error.advice) from None
    settings = {key: value for key, value in resolved.flat().items() if key not in NEUTRAL}
    settings["data"] = str(cell.settings.get("data", ""))
    name = f"seed-{cell.seed}-{fingerprint(settings)}"
    path = folder / "runs" / slug(cell.scene) / slug(cell.row) / name
    return PlannedRun(cell, data, settings, RunFolder(path), _chosen(resolved))


def _chosen(resolved: Settings) -> frozenset[str]:
    """Given keys whose values differ from their defaults."""
    config = resolved.config
    parts = {slot: type(getattr(config, slot))() for slot in resolved.choices}
    defaults = {key.name: plain(key.value) for key in keys(replace(type(config)(), **parts))}
    values = resolved.flat()
    return frozenset(
        key for key in resolved.given if key not in defaults or values[key] != defaults[key]
    )
