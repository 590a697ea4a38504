"""Files: tradeoff.json, .csv and .png, and TensorBoard's HParams page, for all variants."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.studies.json_store import SCHEMA
from gsfw.studies.table import table_of_records
from gsfw.studies.tradeoff import report as models
from gsfw.studies.tradeoff.pareto_plot import write_pareto_plot
from gsfw.studies.tradeoff.recommendation import Recommendation
from gsfw.studies.tradeoff.record import RecordStore
from gsfw.studies.tradeoff.training import report as trainings
from gsfw.studies.tradeoff.training.plot import write_plot
from gsfw.studies.tradeoff.training.trained import Trained, spread

DOCUMENT, TABLE, PLOT = "tradeoff.json", "tradeoff.csv", "tradeoff.png"

BOARD = "tb"
"""Folder of TensorBoard's files, which is made anew each time."""


@dataclass(frozen=True)
class Session:
    """A line of TensorBoard's HParams page."""

    name: str
    settings: Mapping[str, Any]
    metrics: Mapping[str, float | None]
    """Figures; those that are ``None`` are left out."""


def write_model_files(
    store: RecordStore, recommended: Recommendation, about: Mapping[str, Any]
) -> dict[str, Any]:
    """Write the files of a finished model's variants into the folder of the store.

    Args:
        store: of the measurements; its file becomes the document.
        recommended: among the variants.
        about: the model, the views and the machine.

    Returns:
        The document.

    Raises:
        OutputError: a file cannot be written.
    """
    records, folder = models.in_order(list(store.records.values())), store.path.parent
    document = _document(about, recommended, models.documents(records))
    store.write(document)
    sessions = [
        Session(f"{r.axis} {r.name}", {"axis": r.axis, "variant": r.name}, models.metrics(r))
        for r in records
    ]
    _write_tables(folder, document["variants"], sessions)
    write_pareto_plot(folder / PLOT, records)
    return {"written": str(store.path), **document}


def write_training_files(
    folder: Path, found: Sequence[Trained], recommended: Recommendation, about: Mapping[str, Any]
) -> dict[str, Any]:
    """Write the files of trained variants.

    Args:
        folder: of the files.
        found: variants, the baseline among them.
        recommended: among the variants.
        about: the baseline, the lengths and the machine.

    Returns:
        The document.

    Raises:
        OutputError: a file cannot be written.
    """
    about = {"schema": SCHEMA, **about, "psnr_spread": spread(found)}
    document = _document(about, recommended, trainings.documents(found))
    write_atomically(folder / DOCUMENT, (json_text(document, indent=1) + "\n").encode())
    _write_tables(folder, document["variants"], _sessions(found))
    write_plot(folder / PLOT, found)
    return {"written": str(folder / DOCUMENT), **document}


def _document(
    about: Mapping[str, Any], recommended: Recommendation, variants: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    said = {"text": recommended.text, "command": recommended.command}
    return {**about, "recommended": said, "variants": variants}


def _write_tables(
    folder: Path, variants: Sequence[Mapping[str, Any]], sessions: Iterable[Session]
) -> None:
    """Write the CSV, and a session of TensorBoard's page for each variant."""
    write_atomically(folder / TABLE, table_of_records(variants).csv().encode())
    path = folder / BOARD
    with readable_write_errors(path):
        shutil.rmtree(path, ignore_errors=True)
        with SummaryWriter(str(path)) as writer:
            for session in sessions:
                metrics = {f"tradeoff/{k}": v for k, v in session.metrics.items() if v is not None}
                writer.add_hparams(
                    dict(session.settings), metrics, run_name=session.name.replace("/", "-")
                )


def _sessions(found: Sequence[Trained]) -> list[Session]:
    """Every variant with the settings in which any of them differ.

    They are text: a column of TensorBoard's page holds one type.
    """
    usual = dict.fromkeys((key for item in found for key in item.changed), "baseline")
    return [
        Session(
            item.name,
            {
                "variant": item.variant,
                **usual,
                **{key: str(value) for key, value in item.changed.items()},
                "steps": item.steps,
            },
            trainings.metrics(item, found),
        )
        for item in trainings.in_order(found)
    ]
