"""Comparison: the results of a study row by row: means over seeds, spreads, the best, ties."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, stdev

from gsfw.studies.columns import Column, find_column
from gsfw.studies.result import Failure, Result
from gsfw.studies.study import Study


@dataclass(frozen=True)
class Figure:
    """One figure of a row on a scene, over its seeds."""

    mean: float
    spread: float | None
    """Standard deviation over the seeds; ``None`` where there is only one."""
    seeds: int
    is_best: bool = False
    is_tie: bool = False
    """Whether it cannot be told from the best: their means differ by no more than both spreads."""


@dataclass(frozen=True)
class Line:
    """A row on a scene."""

    row: str
    figures: Mapping[str, Figure]
    """By column; what was not measured is absent."""
    note: str = ""
    """Why there are no figures, or fewer than there should be; empty when all is well."""


@dataclass(frozen=True)
class SceneTable:
    """The rows on one scene."""

    scene: str
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]


def compare(
    study: Study,
    results: Mapping[tuple[str, str, int], Result],
    failures: Mapping[tuple[str, str, int], Failure],
) -> list[SceneTable]:
    """A table per scene; scenes of which nothing is known are left out."""
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
    results: Mapping[tuple[str, str, int], Result],
    failures: Mapping[tuple[str, str, int], Failure],
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
        notes.append(f"not made yet: {_seeds(waiting)}")
    given = {cell.key: cell.relevant for cell in cells}
    changed = [result.seed for result in found if dict(result.given) != given[result.key]]
    if changed:
        notes.append(f"made before the settings changed: {_seeds(changed)}")
    return Line(row, figures, "; ".join(notes))


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"


def _figure(values: Sequence[float]) -> Figure:
    return Figure(mean(values), stdev(values) if len(values) > 1 else None, len(values))


def _judged(columns: Iterable[Column], lines: Sequence[Line]) -> list[Line]:
    """The lines with the best of each column marked, and what cannot be told from it."""
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
        # A row with one seed is taken to vary as much as any that was measured on this scene.
        usual = max((value.spread for value in values if value.spread is not None), default=0.0)
        for found, value in zip(present, values, strict=True):
            spreads = [usual if one.spread is None else one.spread for one in (value, best)]
            is_best = value.mean == best.mean
            is_tie = not is_best and abs(value.mean - best.mean) <= sum(spreads)
            found[column.name] = Figure(value.mean, value.spread, value.seeds, is_best, is_tie)
    return [Line(line.row, found, line.note) for line, found in zip(lines, figures, strict=True)]
