"""Writing: the files of a study that are remade from its results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.core.files.atomic import write_atomically
from gsfw.studies.comparison import SceneTable, compare
from gsfw.studies.dot_plot import write_dot_plot
from gsfw.studies.report import csv_text, markdown, protocol_lines
from gsfw.studies.result import Result, ResultStore
from gsfw.studies.study import Study

RESULTS, REPORT, FIGURES, PLOT = "results.json", "study.md", "study.csv", "study.png"
"""Files of a study's folder: what is kept, and what is made of it."""


def write_report(study: Study, store: ResultStore, folder: Path, command: str) -> list[SceneTable]:
    """Write study.md, study.csv and study.png; the tables that are in them.

    Args:
        study: whose rows and scenes are shown.
        store: of results; those of rows and scenes that the study no longer has stay unseen.
        folder: that is written to.
        command: that makes the same files, for the report.

    Raises:
        OutputError: they cannot be written.
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
    """Results of the study's cells, in its order."""
    keys = [cell.key for cell in study.cells()]
    return [store.results[key] for key in keys if key in store.results]
