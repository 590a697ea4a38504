"""Finished runs, and the same resumed from an earlier checkpoint."""

import json
import shutil
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
    run = folder / "whole"
    assert main(["train", *SCENE, *length, f"out={run}", *typed]) == 0
    resumed_to_the_same_bits(run)
    summary: dict[str, Any] = json.loads(RunFolder(run).summary.read_text())
    return summary


def resumed_to_the_same_bits(run: Path) -> RunFolder:
    """A copy of a finished run that was resumed from its last checkpoint but one; compares both."""
    whole, parts = RunFolder(run), RunFolder(shutil.copytree(run, run.with_name("parts")))
    *_, before, last = whole.all_checkpoints()
    (parts.checkpoints / last.name).unlink()
    parts.summary.unlink()
    assert parts.latest_checkpoint().name == before.name
    assert main(["resume", str(parts.path)]) == 0
    states = [read_checkpoint(one.latest_checkpoint()) for one in (whole, parts)]
    for state in states:
        del state["train_seconds"]
    assert_same_bits(*states)
    return parts
