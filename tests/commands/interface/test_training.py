"""Tests of gsfw.commands.interface.training."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from gsfw.commands.interface import training
from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.loop.update import Update
from gsfw.core.rasterizer import Rasterizer
from gsfw.formats.ply import PlyExporter

SMALL = (
    "method=3dgs", "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "steps=2",
)  # fmt: skip


@pytest.fixture
def out(tmp_path) -> str:
    return str(tmp_path / "run")


FULL = (
    "CUDA out of memory. Tried to allocate 2.25 GiB. GPU 0 has a total capacity of 79.15 GiB of "
    "which 1.20 GiB is free. Process 1 has 77.90 GiB memory in use."
)


def test_a_full_gpu_says_what_to_turn_and_how_to_go_on(out, capsys, monkeypatch):
    rendered = Update._rendered

    def fail(self, *arguments):
        if arguments[-1] == 1:  # The step.
            raise torch.OutOfMemoryError(FULL)
        return rendered(self, *arguments)

    monkeypatch.setattr(Update, "_rendered", fail)
    assert main(["train", *SMALL, f"out={out}"]) == 1
    assert capsys.readouterr().err.endswith(
        "error: the GPU's memory is full after 1 steps, with 150 Gaussians: 2.25 GiB were asked "
        "for, and 1.20 GiB were free.\n"
        "A run needs less with smaller images (downscale=2), fewer Gaussians "
        "(strategy.max_gaussians=75) or no images kept there (gpu_cache_mb=0); a lower "
        "rasterizer.pairs_mb refuses single images that need much.\n"
        f"{out}/checkpoints/step_000000001.pt is kept: gsfw resume {out} gpu_cache_mb=0 continues "
        "from there.\n"
    )
    monkeypatch.undo()
    assert main(["resume", out, "gpu_cache_mb=0"]) == 0
    assert RunFolder(Path(out)).splats.is_file()


def test_a_gpu_that_is_full_in_an_evaluation_needs_no_traceback(out, capsys, monkeypatch):
    assert main(["train", *SMALL, f"out={out}"]) == 0

    def fail(*arguments, **settings):
        raise torch.OutOfMemoryError("CUDA out of memory.")

    capsys.readouterr()
    monkeypatch.setattr(Rasterizer, "render", fail)
    for verb in ("eval", "render"):
        assert main([verb, out]) == 1
        assert capsys.readouterr().err.endswith(
            "error: the GPU's memory is full.\n"
            "Smaller images (train: downscale=2, render: scale=0.5), fewer Gaussians (render and "
            "eval: budget=500000) or device=cpu need less; nvidia-smi lists other programs on the "
            "GPU.\n"
        )


def test_a_model_that_no_ply_can_hold_is_no_failure_of_the_run(out, capsys, monkeypatch):
    def fail(*arguments):
        raise ValueError("means: row 3 is too large")

    monkeypatch.setattr(PlyExporter, "write", fail)
    monkeypatch.setattr(training, "without_invisible", lambda taken: (taken, 7))
    assert main(["train", *SMALL, f"out={out}"]) == 0
    said = capsys.readouterr()
    assert "warning: no splats.ply was written: means: row 3 is too large" in said.err
    assert "too faint to be seen" not in said.out
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
        f"stopped after 1 of 2 steps: enough is enough.\nContinue with: gsfw resume {out}\n"
    )
    monkeypatch.undo()
    assert main(["resume", out]) == 0
    assert RunFolder(Path(out)).splats.is_file()


@pytest.mark.parametrize(
    ("divided", "phrase"),
    [
        (False, ", 3 processes for 2 views of a step; 1 without a view"),
        (True, ", 3 processes that share the Gaussians"),
    ],
)
def test_processes_that_share_the_gaussians_all_have_work(divided, phrase):
    team = SimpleNamespace(size=3, shares_rendering=divided)
    sampler = SimpleNamespace(views_per_step=2)
    composition = SimpleNamespace(
        parts=SimpleNamespace(team=team),
        settings=SimpleNamespace(config=SimpleNamespace(sampler=sampler)),
    )
    assert training._of_processes(composition) == phrase
