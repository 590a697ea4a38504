"""A training whose images, losses and steps all come from the CUDA kernels, on the emulation."""

import json
from pathlib import Path

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.native_programs import compiler
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.plugins import compose
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from gsfw.rasterizers.reference.config import ReferenceConfig

STEPS = 25


@pytest.fixture
def on_cuda_kernels(monkeypatch):
    """From here on, what is trained with rasterizer=reference is trained with the CUDA kernels."""
    compiler()
    launcher = EmulatedLauncher(seed=1)
    rasterizer = CudaRasterizer(launcher, deterministic=True)

    def use() -> None:
        monkeypatch.setattr(ReferenceConfig, "build", lambda self, device: rasterizer)
        monkeypatch.setattr(compose, "choose_operators", lambda *_: CudaOperators(launcher))

    return use


def train(out: Path) -> dict[str, torch.Tensor]:
    """Train a short run; the model it ends with."""
    arguments = ["train", "method=3dgs", *SMALL_SCENE, "rasterizer=reference", "rescale=false"]
    arguments += [f"steps={STEPS}", "log_every=1", f"out={out}"]
    arguments += ["strategy.refine_start=10", "strategy.refine_every=10"]
    assert main(arguments) == 0
    checkpoint = max((out / "checkpoints").glob("*.pt"))
    return read_checkpoint(checkpoint)["model"]


def losses(out: Path) -> torch.Tensor:
    lines = map(json.loads, (out / "metrics.jsonl").read_text().splitlines())
    return torch.tensor([line["loss"] for line in lines if "loss" in line], dtype=torch.float64)


@pytest.mark.slow
def test_a_training_on_cuda_kernels_follows_the_reference(tmp_path, on_cuda_kernels):
    expected = train(tmp_path / "reference")
    on_cuda_kernels()
    found = train(tmp_path / "cuda")
    assert found.keys() == expected.keys()
    first, second = losses(tmp_path / "cuda"), losses(tmp_path / "reference")
    assert len(first) == STEPS
    torch.testing.assert_close(first, second, rtol=2e-3, atol=0)
    assert len(found["means.values"]) == len(expected["means.values"]) > 150


@pytest.mark.slow
def test_a_training_on_cuda_kernels_has_the_same_bits_each_time(tmp_path, on_cuda_kernels):
    on_cuda_kernels()
    first, second = (train(tmp_path / name) for name in ("first", "second"))
    assert all(torch.equal(first[name], second[name]) for name in first)
