"""Whole runs on a small built-in scene that moves."""

import json
from pathlib import Path

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder

MOVING = (
    *("device=cpu", "datamanager.moving=true", "datamanager.times=4", "datamanager.views=12"),
    *("datamanager.eval_views=2", "datamanager.width=32", "datamanager.height=24"),
    *("datamanager.points=150", "report=false"),
)
"""Settings of the scene; what a test gives after them wins."""


def train(out: Path, *arguments: str) -> dict[str, float]:
    """Train on it; the run's final figures."""
    assert main(["train", *MOVING, f"out={out}", *arguments]) == 0
    figures: dict[str, float] = json.loads(RunFolder(out).summary.read_text())
    return figures
