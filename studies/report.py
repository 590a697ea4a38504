"""Report: a study in Markdown, as CSV, as plain data, and as tables; and the files of these."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gsfw.core.files.atomic import write_atomically
from gsfw.plugins.values import as_text
from gsfw.studies.comparison import Column, Line, SceneTable, compare, heading
from gsfw.studies.dot_plot import write_dot_plot
from gsfw.studies.result import Result, ResultStore
from gsfw.studies.study import Study
from gsfw.studies.table import Table, cell_text

RESULTS, REPORT, FIGURES, PLOT = "results.json", "study.md", "study.csv", "study.png"
"""Files of a study's folder: the kept results, and the files that are made of them."""

ABSENT = "-"
"""Stands for a figure that was not measured."""

TIE = " ≈"
"""Follows a figure that is a tie with the best."""

LEGEND = "The best is bold."
LEGEND_SEEDS = (
    "± is the standard deviation over seeds; ≈ is a tie with the best: the two differ by no more "
    "than the sum of their spreads (a row with one seed has the largest spread of the scene)."
)


def figure_text(column: Column, line: Line, bold: bool) -> str:
    """A figure of a line, with its spread.

    Args:
        column: of the figure.
        line: of the table.
        bold: mark the best by bold type, as Markdown has it; else by a star.
    """
    figure = line.figures.get(column.name)
    if figure is None:
        return ABSENT
    text = column.text(figure.mean)
    if figure.spread:
        text += f" ± {column.text(figure.spread)}"
    if figure.is_best:
        return f"**{text}**" if bold else f"{text} *"
    return text + (TIE if figure.is_tie else "")


def table_of(scene: SceneTable, bold: bool = False) -> Table:
    """The rows of a scene that have figures; ``bold`` as for ``figure_text``."""
    headings = ["", *(heading(column) for column in scene.columns)]
    rows = [
        [line.row, *(figure_text(column, line, bold) for column in scene.columns)]
        for line in scene.lines
        if line.figures
    ]
    return Table(headings, rows, scene.scene)


def markdown(
    study: Study, tables: Sequence[SceneTable], protocol: Sequence[str], plot: str | None
) -> str:
    """The whole report.

    Args:
        study: that was made.
        tables: one per scene.
        protocol: lines on how the figures were made.
        plot: file name of the plot; ``None`` for none.
    """
    blocks = [f"# {study.title}"]
    blocks += [study.about] if study.about else []
    blocks += ["\n".join(f"- {line}" for line in protocol)] if protocol else []
    with_seeds = any(
        figure.spread is not None
        for table in tables
        for line in table.lines
        for figure in line.figures.values()
    )
    if any(line.figures for table in tables for line in table.lines):
        blocks.append(f"{LEGEND} {LEGEND_SEEDS}" if with_seeds else LEGEND)
    for table in tables:
        blocks.append(f"## {table.scene}")
        shown = table_of(table, bold=True)
        blocks += [shown.markdown()] if shown.rows else []
        notes = [f"- {line.row}: {line.note}" for line in table.lines if line.note]
        blocks += ["\n".join(notes)] if notes else []
    if plot:
        blocks.append(f"![{study.title}]({plot})")
    return "\n\n".join(blocks) + "\n"


def documents(tables: Iterable[SceneTable]) -> list[dict[str, Any]]:
    """The tables as plain data."""
    return [
        {
            "scene": table.scene,
            "rows": [
                {
                    "row": line.row,
                    "figures": {name: asdict(figure) for name, figure in line.figures.items()},
                    "note": line.note,
                }
                for line in table.lines
            ],
        }
        for table in tables
    ]


def csv_text(study: Study, results: Sequence[Result]) -> str:
    """A line for each run with every figure; the study's columns come first."""
    named = dict.fromkeys(study.columns)
    named |= dict.fromkeys(key for result in results for key in sorted(result.figures))
    rows = [
        [
            *(result.scene, result.row, str(result.seed)),
            *(cell_text(result.figures.get(name)) for name in named),
            result.fingerprint,
            str(result.origin.get("commit") or result.origin.get("gsfw", "")),
            result.date,
        ]
        for result in results
    ]
    return Table(["scene", "row", "seed", *named, "settings", "commit", "date"], rows).csv()


def protocol_lines(study: Study, results: Sequence[Result], command: str) -> list[str]:
    """Lines on how the figures were made: data, lengths, seeds, machine, versions, command."""
    settings = [result.settings for result in results]
    protocols = [result.protocol for result in results]
    origins = [result.origin for result in results]
    return [
        f"steps {_values(settings, 'steps')}; downscale {_values(settings, 'downscale')} "
        f"({_values(protocols, 'downscale_filter')} filter); "
        f"seeds {', '.join(str(seed) for seed in sorted({r.seed for r in results}))}",
        f"rows: {'; '.join(_row_text(name, given) for name, given in study.rows.items())}",
        f"held-out views, {_values(protocols, 'checkpoint')} checkpoint; "
        f"PSNR {_values(protocols, 'psnr')}; SSIM {_values(protocols, 'ssim')}",
        f"held out: {'; '.join(_images(study, results)) or 'unknown'}",
        f"machine: {_values(origins, 'cpu')}, {_values(origins, 'cores')} cores, threads per run "
        f"{_values(origins, 'threads')}; rasterizer {_values(settings, 'rasterizer')}; "
        f"torch {_values(origins, 'torch')}",
        f"gsfw {_values(origins, 'gsfw')}, commit {_values(origins, 'commit')}; "
        f"made {_values([{'date': result.date} for result in results], 'date')}",
        f"command: `{command}`",
    ]


def _row_text(name: str, given: Mapping[str, Any]) -> str:
    """A row and its settings, as they are typed."""
    typed = " ".join(f"{key}={as_text(value)}" for key, value in given.items())
    return f"{name} (`{typed}`)" if typed else name


def _images(study: Study, results: Sequence[Result]) -> Iterator[str]:
    """Number and sizes of the held-out images of each scene."""
    for scene in study.scenes:
        protocols = [result.protocol for result in results if result.scene == scene]
        sizes = {(w, h) for protocol in protocols for w, h in protocol.get("image_sizes", [])}
        if sizes:
            listed = ", ".join(f"{w}x{h}" for w, h in sorted(sizes))
            yield f"{scene} {_values(protocols, 'views')} images of {listed}"


def _values(documents: Iterable[Mapping[str, Any]], key: str) -> str:
    """The values of documents under a key, each once; for example "1000, 1500"."""
    values = {document[key] for document in documents if document.get(key) is not None}
    numbers = all(isinstance(value, int | float) for value in values)
    listed = sorted(values) if numbers else sorted(values, key=str)
    return ", ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in listed) or "unknown"


def write_report(study: Study, store: ResultStore, folder: Path, command: str) -> list[SceneTable]:
    """Write study.md, study.csv and study.png.

    Args:
        study: names the rows and scenes.
        store: of results; rows and scenes that the study no longer has are left out.
        folder: of the files.
        command: makes the same files; is shown in the report.

    Returns:
        The tables of the report.

    Raises:
        OutputError: a file cannot be written.
    """
    tables = compare(study, store.results, store.failures)
    shown = shown_results(study, store)
    if not tables:
        return []
    plot = PLOT if write_dot_plot(folder / PLOT, tables) else None
    protocol = protocol_lines(study, shown, command) if shown else []
    text = markdown(study, tables, protocol, plot)
    write_atomically(folder / REPORT, text.encode())
    write_atomically(folder / FIGURES, csv_text(study, shown).encode())
    return tables


def shown_results(study: Study, store: ResultStore) -> Sequence[Result]:
    """Results of the study's cells, in their order."""
    keys = [cell.key for cell in study.cells()]
    return [store.results[key] for key in keys if key in store.results]
