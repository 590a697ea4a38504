"""Whole runs on a small scene that moves, once in one go and once interrupted."""

import json
from pathlib import Path
from typing import Any

from gsfw.commands.main import main
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from support.states import assert_same_bits

SCENE = (
    *("device=cpu", "datamanager.moving=true", "datamanager.views=12", "datamanager.times=4"),
    *("datamanager.eval_views=2", "datamanager.width=32", "datamanager.height=24"),
    *("datamanager.points=150", "report=false"),
)
STEPS, HALF = 20, 10


def resumes_to_the_same_bits(folder: Path, *typed: str) -> dict[str, Any]:
    """Check it of a run of 20 steps that goes on from a checkpoint at 10; the run's summary."""
    length = (f"steps={STEPS}", f"checkpoint_every={HALF}", "eval_every=0")
    for name in ("whole", "parts"):
        assert main(["train", *SCENE, *length, f"out={folder / name}", *typed]) == 0
    whole, parts = RunFolder(folder / "whole"), RunFolder(folder / "parts")
    parts.checkpoint(STEPS).unlink()
    parts.summary.unlink()
    assert main(["resume", str(parts.path)]) == 0
    states = [read_checkpoint(run.checkpoint(STEPS)) for run in (whole, parts)]
    for state in states:
        del state["train_seconds"]
    assert_same_bits(*states)
    summary: dict[str, Any] = json.loads(whole.summary.read_text())
    return summary
