"""Tests of gsfw.commands.interface.training."""

from pathlib import Path

import pytest
import torch

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.formats.ply import PlyExporter

SMALL = (
    "method=3dgs", "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "steps=2",
)  # fmt: skip


@pytest.fixture
def out(tmp_path) -> str:
    return str(tmp_path / "run")


def test_a_full_gpu_says_what_to_turn(out, capsys, monkeypatch):
    def fail(self, afterwards):
        raise torch.OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(Trainer, "fit", fail)
    assert main(["train", *SMALL, f"out={out}"]) == 1
    assert capsys.readouterr().err == (
        "error: the GPU's memory is full after 0 steps, with 150 Gaussians.\n"
        "Keep no images there (gpu_cache_mb=0), shrink them (downscale=2), or limit the number "
        "of Gaussians (strategy=mcmc strategy.cap_max=500000).\n"
    )


def test_a_model_that_no_ply_can_hold_is_no_failure_of_the_run(out, capsys, monkeypatch):
    def fail(*arguments):
        raise ValueError("means: row 3 is too large")

    monkeypatch.setattr(PlyExporter, "write", fail)
    assert main(["train", *SMALL, f"out={out}"]) == 0
    said = capsys.readouterr()
    assert "warning: no splats.ply was written: means: row 3 is too large" in said.err
    assert "done: 3dgs on synthetic, 2 steps" in said.out


def test_a_run_that_was_stopped_says_why_and_how_to_go_on(out, capsys, monkeypatch):
    one_step = Trainer._one_step

    def step_and_stop(self):
        one_step(self)
        self.control.request_stop("enough is enough")

    monkeypatch.setattr(Trainer, "_one_step", step_and_stop)
    assert main(["train", *SMALL, f"out={out}"]) == 0
    said = capsys.readouterr().out
    assert said.endswith(
        f"stopped after 1 of 2 steps: enough is enough.\nGo on with: gsfw resume {out}\n"
    )
    monkeypatch.undo()
    assert main(["resume", out]) == 0
    assert RunFolder(Path(out)).splats.is_file()
