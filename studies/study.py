"""Study: a table of runs: rows that are compared on scenes, with seeds and exceptions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import did_you_mean

COLUMNS = ("psnr", "ssim", "num_gaussians", "megabytes", "train_seconds", "render_ms")
"""Default columns."""


NEUTRAL = (
    "out",
    "log_every",
    "eval_every",
    "eval_views",
    "checkpoint_every",
    "cache_mb",
    "gpu_cache_mb",
    "check_memory",
)
"""Settings that change no result: a finished run stays finished when they change."""


@dataclass(frozen=True)
class Rule:
    """Different settings, seeds or a reason to skip, for some cells of the table."""

    rows: tuple[str, ...]
    """Names or patterns of rows, for example 4d*."""
    scenes: tuple[str, ...]
    """Names or patterns of scenes."""
    seeds: tuple[int, ...] | None = None
    """Seeds of these cells; ``None`` for those of the study."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of these cells; they override all others."""
    skip: str = ""
    """Reason to leave these cells out; empty for none."""

    def covers(self, row: str, scene: str) -> bool:
        """True if the rule applies to a cell."""
        return matches(row, self.rows) and matches(scene, self.scenes)


@dataclass(frozen=True)
class Cell:
    """One run of a study, as described by its file."""

    row: str
    scene: str
    settings: Mapping[str, Any]
    """Settings by dotted key, with the seed; ``data`` as it is written."""

    @property
    def relevant(self) -> dict[str, Any]:
        """The settings that the result depends on."""
        return {key: value for key, value in self.settings.items() if key not in NEUTRAL}

    @property
    def seed(self) -> int:
        """Seed of every generator."""
        return int(self.settings["seed"])

    @property
    def key(self) -> tuple[str, str, int]:
        """Scene, row and seed."""
        return self.scene, self.row, self.seed

    @property
    def name(self) -> str:
        """Name for people."""
        return f"{self.row} on {self.scene}, seed {self.seed}"


@dataclass(frozen=True)
class Study:
    """A table of runs."""

    name: str
    """Name of its folder."""
    title: str
    rows: Mapping[str, Mapping[str, Any]]
    """Settings of each row, by dotted key."""
    scenes: Mapping[str, Mapping[str, Any]]
    """Settings of each scene; ``data`` is a path relative to a root."""
    about: str = ""
    """A paragraph for the report."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every run; overridden by a scene's, then by a row's, then by a rule's."""
    seeds: tuple[int, ...] = (42,)
    rules: tuple[Rule, ...] = ()
    columns: tuple[str, ...] = COLUMNS
    """Names of the shown figures, in order."""

    def cells(self, only: Sequence[str] = ()) -> list[Cell]:
        """The runs scene by scene; those that ``only`` names where it is not empty.

        Args:
            only: names or patterns of rows and of scenes. Those of rows limit the rows, those of
                scenes the scenes.

        Raises:
            ConfigError: one of them names neither a row nor a scene.
        """
        rows = [name for name in self.rows if matches(name, only)] or list(self.rows)
        scenes = [name for name in self.scenes if matches(name, only)] or list(self.scenes)
        for pattern in only:
            if not any(matches(name, [pattern]) for name in (*self.rows, *self.scenes)):
                known = [*self.rows, *self.scenes]
                raise ConfigError(
                    f"only={pattern}: {self.title!r} has no such row or scene."
                    f"{did_you_mean(pattern, known)}",
                    f"Rows: {', '.join(self.rows)}. Scenes: {', '.join(self.scenes)}.",
                )
        return [
            cell
            for scene in scenes
            for row in rows
            if not self.skipped(row, scene)
            for cell in self.cells_of(row, scene)
        ]

    def cells_of(self, row: str, scene: str) -> list[Cell]:
        """The runs of a row on a scene, one per seed."""
        settings = {**self.settings, **self.scenes[scene], **self.rows[row]}
        seeds = self.seeds
        for rule in self.rules:
            if rule.covers(row, scene):
                settings |= rule.settings
                seeds = seeds if rule.seeds is None else rule.seeds
        return [Cell(row, scene, {**settings, "seed": seed}) for seed in seeds]

    def skipped(self, row: str, scene: str) -> str:
        """Reason to leave a cell out; empty for none."""
        reasons = (rule.skip for rule in self.rules if rule.covers(row, scene))
        return next((reason for reason in reasons if reason), "")


def matches(name: str, patterns: Iterable[str]) -> bool:
    """True if a name equals or fits any of the patterns; names may hold brackets."""
    return any(pattern == name or fnmatchcase(name, pattern) for pattern in patterns)


def slug(name: str) -> str:
    """A name as part of a path."""
    return re.sub(r"[^\w.+-]+", "-", name).strip("-.") or "run"
