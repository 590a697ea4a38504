"""Writing: the files of variants that were trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.studies.tradeoff.hyperparameters import Session, write_hyperparameters
from gsfw.studies.tradeoff.recommendation import Recommendation
from gsfw.studies.tradeoff.training.plot import write_plot
from gsfw.studies.tradeoff.training.report import csv_text, documents, in_order, yardstick
from gsfw.studies.tradeoff.training.trained import Trained, spread

DOCUMENT, TABLE, PLOT = "tradeoff.json", "tradeoff.csv", "tradeoff.png"

SCHEMA = 1
"""Number of the layout of the document."""


def write_files(
    folder: Path, found: Sequence[Trained], recommended: Recommendation, about: Mapping[str, Any]
) -> dict[str, Any]:
    """Write the document, the table, the plot and TensorBoard's page; the document.

    Args:
        folder: that is written to.
        found: variants, the baseline among them.
        recommended: what is said of them.
        about: what was trained, how, and where.

    Raises:
        OutputError: they cannot be written.
    """
    document = {
        "schema": SCHEMA,
        **about,
        "psnr_spread": spread(found),
        "recommended": {"text": recommended.text, "command": recommended.command},
        "variants": documents(found),
    }
    write_atomically(folder / DOCUMENT, (json_text(document, indent=1) + "\n").encode())
    write_atomically(folder / TABLE, csv_text(found).encode())
    write_plot(folder / PLOT, found)
    write_hyperparameters(folder, _sessions(found))
    return {"written": str(folder / DOCUMENT), **document}


def _sessions(found: Sequence[Trained]) -> list[Session]:
    """Every variant with what distinguishes any of them."""
    first = yardstick(found)
    names = dict.fromkeys(key for item in found for key in item.changed)
    usual = {key: "baseline" for key in names}
    return [
        Session(
            item.name,
            {"variant": item.variant, **usual, **_typed(item, names), "steps": item.steps},
            {
                "psnr": item.psnr,
                "ssim": item.ssim,
                "flip": item.flip,
                "psnr_lost": first.psnr - item.psnr,
                "megabytes": item.file_mb,
                "num_gaussians": item.num_gaussians,
                "train_seconds": item.train_seconds,
                "render_ms": item.draw_ms,
                "peak_memory_mb": item.peak_memory_mb,
            },
        )
        for item in in_order(found)
    ]


def _typed(item: Trained, names: Mapping[str, None]) -> dict[str, str]:
    """Changed settings as text: one column of TensorBoard's page holds one type."""
    return {key: str(item.changed[key]) for key in names if key in item.changed}
