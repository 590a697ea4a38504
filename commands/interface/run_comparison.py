"""Comparison of runs: the settings in which they differ, and their figures side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.commands.interface.run_record import RunRecord, read_record
from gsfw.commands.interface.summary import duration, size
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.config_file import read_config
from gsfw.plugins.values import as_text

FIGURES = ("psnr", "ssim", "moving_psnr", "num_gaussians", "model_bytes", "train_seconds")
MORE_FIGURES = ("peak_memory_mb", "peak_gpu_memory_mb", "render_ms", "training_psnr")
"""Figures of metrics.json, in the order of the table; those that no run has are left out."""

NAMES = {
    "psnr": "PSNR", "ssim": "SSIM", "moving_psnr": "PSNR of what moves",
    "num_gaussians": "Gaussians", "model_bytes": "model", "train_seconds": "training",
    "peak_memory_mb": "memory", "peak_gpu_memory_mb": "memory of the GPU",
    "render_ms": "rendering an image", "training_psnr": "PSNR of training views",
}  # fmt: skip

CHOICES = (
    *("method", "preset", "strategy", "rasterizer", "datamanager", "sampler"),
    *("data", "device", "steps", "seed", "downscale"),
)
"""Settings that are shown wherever they differ; of the others those that a user chose."""


@dataclass(frozen=True)
class Comparison:
    """Two or more runs side by side; every row has a value for each run."""

    runs: tuple[RunRecord, ...]
    settings: dict[str, list[Any]]
    """Those that differ; ``None`` where a run has no such setting."""
    chosen: tuple[str, ...]
    """Which of them somebody chose; the others follow from these."""
    figures: dict[str, list[Any]]
    """``None`` where a run has no such figure."""
    protocol: dict[str, list[Any]]
    """Differences in how the figures were measured: they cannot be compared then."""

    def document(self) -> dict[str, Any]:
        """Plain data for programs."""
        return {
            "runs": [run.document() for run in self.runs],
            "settings": self.settings,
            "chosen": list(self.chosen),
            "figures": self.figures,
            "protocol": self.protocol,
        }

    def figure_rows(self) -> list[list[str]]:
        """Rows of a table of the figures, in words."""
        states = [f"{run.state.value}, {run.steps_done} steps" for run in self.runs]
        rows = [["state", *states]]
        for name, values in self.figures.items():
            rows.append([NAMES[name], *(_words(name, value) for value in values)])
        return rows

    def setting_rows(self) -> list[list[str]]:
        """Rows of a table of the chosen settings that differ."""
        return [[name, *map(_setting, self.settings[name])] for name in self.chosen]

    def following(self) -> list[str]:
        """Names of the settings that differ because others do."""
        return [name for name in self.settings if name not in self.chosen]


def compare(paths: Sequence[Path]) -> Comparison:
    """Compare runs by their files.

    Raises:
        ConfigError: the settings of one cannot be read.
    """
    records = tuple(read_record(path) for path in paths)
    layers = [read_config(RunFolder(path).config, everything=True) for path in paths]
    settings = _differing([layer.values for layer in layers])
    chosen = [
        key
        for key in settings
        if key in CHOICES or any(layer.given and key in layer.given for layer in layers)
    ]
    summaries = [_summary(RunFolder(path)) for path in paths]
    for record, summary in zip(records, summaries, strict=True):
        summary.setdefault("psnr", record.psnr)
        summary.setdefault("num_gaussians", record.gaussians)
        summary.setdefault("train_seconds", record.train_seconds)
    figures = {
        name: [summary.get(name) for summary in summaries] for name in (*FIGURES, *MORE_FIGURES)
    }
    protocols = [summary["protocol"] for summary in summaries if summary.get("protocol")]
    return Comparison(
        records,
        settings,
        tuple(chosen),
        {name: values for name, values in figures.items() if any(v is not None for v in values)},
        _differing(protocols),
    )


def _summary(folder: RunFolder) -> dict[str, Any]:
    try:
        document: dict[str, Any] = json.loads(folder.summary.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return document


def _differing(documents: Sequence[Any]) -> dict[str, list[Any]]:
    """The keys whose values are not the same everywhere, with the value of each document."""
    keys = dict.fromkeys(key for document in documents for key in document)
    found = {key: [document.get(key) for document in documents] for key in keys}
    return {key: values for key, values in found.items() if any(v != values[0] for v in values)}


def _setting(value: object) -> str:
    return "-" if value is None else as_text(value) or "(empty)"


def _words(name: str, value: Any) -> str:  # noqa: ANN401 - a figure of any kind
    if value is None:
        return "-"
    if name.endswith("psnr"):
        return f"{value:.2f} dB"
    if name == "model_bytes":
        return size(value)
    if name.endswith("memory_mb"):
        return size(1e6 * value)
    if name == "train_seconds":
        return duration(value)
    return {"num_gaussians": f"{value:,}", "render_ms": f"{value:.1f} ms"}.get(name, f"{value:.4f}")
