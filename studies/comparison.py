"""Comparison: tables of a study's results: means over seeds, spreads, the best, and ties."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, stdev

from gsfw.studies.result import Failure, Result, RunKey
from gsfw.studies.study import Study


@dataclass(frozen=True)
class Column:
    """A figure of a table."""

    name: str
    """Key among a result's figures."""
    heading: str
    digits: int | None = None
    """Digits after the point; ``None`` for three significant digits."""
    best: str = ""
    """high or low: the more accurate end. Empty for figures that are no accuracy."""
    unit: str = ""

    def text(self, value: float) -> str:
        """A value as text."""
        if self.digits is None:
            return f"{value:.3g}"
        return f"{value:,.{self.digits}f}"

    def better(self, value: float, than: float) -> bool:
        """True if one value is more accurate than another."""
        return value < than if self.best == "low" else value > than


KNOWN = {
    column.name: column
    for column in (
        Column("psnr", "PSNR", 2, "high", "dB"),
        Column("moving_psnr", "moving PSNR", 2, "high", "dB"),
        Column("ssim", "SSIM", 4, "high"),
        Column("moving_ssim", "moving SSIM", 4, "high"),
        Column("lpips", "LPIPS", 4, "low"),
        Column("flip", "FLIP", 4, "low"),
        Column("flicker_static", "static flicker", 5, "low"),
        Column("flicker_moving", "moving flicker", 5, "low"),
        Column("num_gaussians", "Gaussians", 0),
        Column("total_floats", "floats", 0),
        Column("sh_floats", "colour floats", 0),
        Column("sh_share", "of all bands", 2),
        Column("steps", "steps", 0),
        Column("skipped_steps", "skipped steps", 0),
        Column("train_seconds", "training", 0, unit="s"),
        Column("wall_seconds", "wall clock", 0, unit="s"),
        Column("render_ms", "render", 1, unit="ms"),
        Column("megabytes", "model", 2, unit="MB"),
        Column("checkpoint_megabytes", "checkpoint", 1, unit="MB"),
        Column("splats_megabytes", "splats.ply", 1, unit="MB"),
    )
}


def find_column(name: str) -> Column:
    """The column of a figure; an unknown figure gets a column with its own name."""
    return KNOWN.get(name) or Column(name, name.replace("_", " "))


def heading(column: Column) -> str:
    """Heading of a column with its unit."""
    return f"{column.heading} ({column.unit})" if column.unit else column.heading


@dataclass(frozen=True)
class Figure:
    """One figure of a row on a scene over its seeds."""

    mean: float
    spread: float | None
    """Standard deviation over the seeds; ``None`` for a single seed."""
    seeds: int
    is_best: bool = False
    is_tie: bool = False
    """True if its mean differs from the best by no more than the sum of their spreads."""


@dataclass(frozen=True)
class Line:
    """A row on a scene."""

    row: str
    figures: Mapping[str, Figure]
    """Figures by column; figures that were not measured are absent."""
    note: str = ""
    """Reason of missing figures; empty when all are there."""


@dataclass(frozen=True)
class SceneTable:
    """The rows on one scene."""

    scene: str
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]


def compare(
    study: Study,
    results: Mapping[RunKey, Result],
    failures: Mapping[RunKey, Failure],
) -> list[SceneTable]:
    """A table for each scene; scenes without results and failures are left out."""
    tables: list[SceneTable] = []
    columns = tuple(find_column(name) for name in study.columns)
    for scene in study.scenes:
        lines = [_line(study, scene, row, results, failures) for row in study.rows]
        has_failed = any((scene, row) == key[:2] for key in failures for row in study.rows)
        if has_failed or any(line.figures for line in lines):
            judged = _judged(columns, lines)
            shown = tuple(c for c in columns if any(c.name in line.figures for line in lines))
            tables.append(SceneTable(scene, shown, tuple(judged)))
    return tables


def _line(
    study: Study,
    scene: str,
    row: str,
    results: Mapping[RunKey, Result],
    failures: Mapping[RunKey, Failure],
) -> Line:
    reason = study.skipped(row, scene)
    if reason:
        return Line(row, {}, reason)
    cells = study.cells_of(row, scene)
    found = [results[cell.key] for cell in cells if cell.key in results]
    failed = [failures[cell.key] for cell in cells if cell.key in failures]
    figures = {
        name: _figure([float(result.figures[name]) for result in found if name in result.figures])
        for name in study.columns
        if any(name in result.figures for result in found)
    }
    notes = [f"seed {failure.seed} failed: {failure.error}" for failure in failed]
    waiting = [cell.seed for cell in cells if cell.key not in {*results, *failures}]
    if waiting:
        notes.append(f"not trained yet: {_seeds(waiting)}")
    given = {cell.key: cell.relevant for cell in cells}
    changed = [result.seed for result in found if dict(result.given) != given[result.key]]
    if changed:
        notes.append(f"trained before the settings changed: {_seeds(changed)}")
    return Line(row, figures, "; ".join(notes))


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"


def _figure(values: Sequence[float]) -> Figure:
    return Figure(mean(values), stdev(values) if len(values) > 1 else None, len(values))


def _judged(columns: Iterable[Column], lines: Sequence[Line]) -> list[Line]:
    """The lines with the best of each column and its ties marked."""
    figures = [dict(line.figures) for line in lines]
    for column in columns:
        present = [found for found in figures if column.name in found]
        if not column.best or len(present) < 2:
            continue
        values = [found[column.name] for found in present]
        best = values[0]
        for value in values:
            if column.better(value.mean, best.mean):
                best = value
        # A row with one seed gets the largest spread of the scene.
        usual = max((value.spread for value in values if value.spread is not None), default=0.0)
        for found, value in zip(present, values, strict=True):
            spreads = [usual if one.spread is None else one.spread for one in (value, best)]
            is_best = value.mean == best.mean
            is_tie = not is_best and abs(value.mean - best.mean) <= sum(spreads)
            found[column.name] = Figure(value.mean, value.spread, value.seeds, is_best, is_tie)
    return [Line(line.row, found, line.note) for line, found in zip(lines, figures, strict=True)]
