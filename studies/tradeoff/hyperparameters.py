"""Hyperparameters: variants as TensorBoard's HParams page shows them."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

from gsfw.core.files.atomic import readable_write_errors

FOLDER = "tb"
"""In the folder of the results; made anew each time."""


@dataclass(frozen=True)
class Session:
    """A line of the page."""

    name: str
    settings: Mapping[str, Any]
    metrics: Mapping[str, float | None]
    """What is ``None`` is left out."""


def write_hyperparameters(folder: Path, sessions: Iterable[Session]) -> None:
    """Write one session for each variant.

    Raises:
        OutputError: they cannot be written.
    """
    path = folder / FOLDER
    with readable_write_errors(path):
        shutil.rmtree(path, ignore_errors=True)
        with SummaryWriter(str(path)) as writer:
            for session in sessions:
                metrics = {f"tradeoff/{k}": v for k, v in session.metrics.items() if v is not None}
                settings = {key: _plain(value) for key, value in session.settings.items()}
                writer.add_hparams(settings, metrics, run_name=session.name.replace("/", "-"))


def _plain(value: Any) -> bool | int | float | str:  # noqa: ANN401 - any setting
    """What the page can show of a setting."""
    return value if isinstance(value, bool | int | float | str) else str(value)
