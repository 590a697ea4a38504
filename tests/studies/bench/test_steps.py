"""A step as gsplat's trainer does it, over a stand-in for gsplat on the CPU."""

import sys
from types import SimpleNamespace

import pytest
import torch
from support import fake_gsplat

from gsfw.core.operators import Operators
from gsfw.studies.bench import steps as bench_steps
from gsfw.studies.bench.steps import GsplatStep, gsplat_steps, ssim_source
from gsfw.studies.bench.workload import Workload, scattered

CPU = torch.device("cpu")


@pytest.fixture
def workload() -> Workload:
    """Fifty splats, ten of which lie behind the camera."""
    splats, cameras = scattered(50, 20, 12, CPU)
    splats.means[:10, 2] *= -1
    return Workload("small", splats, cameras)


class Selective(torch.optim.Adam):
    """Takes what gsplat's SelectiveAdam takes."""

    seen: torch.Tensor

    def step(self, visibility):
        assert len(self.param_groups) == 1
        assert visibility.shape == (50,)
        assert visibility.dtype == torch.bool
        Selective.seen = visibility
        super().step()


def moved(step: GsplatStep) -> set[str]:
    """Names of the parameters that a step moves."""
    before = {name: value.detach().clone() for name, value in step._parameters.items()}
    step.run()
    after = step._parameters
    assert all(value.grad is None for value in after.values())
    return {name for name in before if not torch.equal(before[name], after[name])}


def test_a_step_moves_every_parameter(workload, monkeypatch):
    monkeypatch.setattr(bench_steps, "RATE", 1e-2)
    step = GsplatStep(fake_gsplat, workload, Operators())
    assert moved(step) == {"means", "scales", "quats", "opacities", "sh0", "shN"}


def test_a_selective_optimizer_is_told_what_is_seen(workload, monkeypatch):
    monkeypatch.setattr(bench_steps, "RATE", 1e-2)
    step = GsplatStep(fake_gsplat, workload, Operators(), Selective)
    assert "means" in moved(step)
    assert Selective.seen.tolist() == [False] * 10 + [True] * 40


def test_fused_ssim_is_used_where_it_is_installed(workload, monkeypatch):
    shapes = []

    def fused_ssim(one, two, padding):
        assert padding == "valid"
        shapes.extend([one.shape, two.shape])
        return (one * two).mean()

    assert ssim_source() == "ours"
    module = SimpleNamespace(fused_ssim=fused_ssim, __spec__=SimpleNamespace())
    monkeypatch.setitem(sys.modules, "fused_ssim", module)
    assert ssim_source() == "fused-ssim"
    GsplatStep(fake_gsplat, workload, Operators()).run()
    assert shapes == [(1, 3, 12, 20)] * 2


@pytest.mark.parametrize("sparse", [False, True])
def test_sparse_steps_are_measured_where_gsplat_has_its_optimizer(workload, monkeypatch, sparse):
    monkeypatch.setattr(bench_steps.package, "load", lambda: fake_gsplat)
    optimizers = SimpleNamespace(SelectiveAdam=Selective)
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(optimizers=optimizers))
    monkeypatch.setitem(sys.modules, "gsplat.optimizers", optimizers)
    steps = gsplat_steps(workload, Operators(), sparse)
    assert list(steps) == (["own_step", "own_sparse_step"] if sparse else ["own_step"])
