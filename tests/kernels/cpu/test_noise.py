"""The fused noise of positions against plain torch in float64."""

import pytest
import torch

from gsfw.core.maths.covariance_noise import shaped_noise
from gsfw.core.operators import Operators
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")


def columns(count: int, dtype: torch.dtype = torch.float32) -> list[torch.Tensor]:
    """Means, quaternions, log scales, opacity logits and normal numbers."""
    generator = torch.Generator().manual_seed(7)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(shape, dtype=torch.float64, generator=generator)

    logits = torch.linspace(-12, 12, count, dtype=torch.float64)
    found = [normal(count, 3), 3 * normal(count, 4), normal(count, 3) - 4, logits, normal(count, 3)]
    return [tensor.to(dtype) for tensor in found]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 500])
def test_shifts_agree_with_those_in_float64(count, dtype):
    means, *others = columns(count, dtype)
    exact = shaped_noise(*(tensor.double() for tensor in others), rate=30.0)
    moved = means.clone()
    CpuOperators().add_noise_(moved, *others, rate=30.0)
    size = float(exact.abs().max()) if count else 0.0
    eps = torch.finfo(dtype).eps
    error = (moved.double() - means.double() - exact).abs()
    assert bool((error <= 2 * eps * means.abs() + 1e2 * eps * size).all())


def test_faint_rows_move_and_opaque_ones_stay():
    means, quats, log_scales, _, noise = columns(64)
    logits = torch.where(torch.arange(64) < 32, -9.0, 9.0)
    moved = means.clone()
    CpuOperators().add_noise_(moved, quats, log_scales, logits, noise, rate=30.0)
    assert bool((moved != means)[:32].all())
    assert torch.equal(moved[32:], means[32:])


@pytest.mark.parametrize("logit", [-1e4, -200.0, 200.0, 1e4])
def test_extreme_opacities_and_scales_give_finite_shifts(logit):
    means, quats, log_scales, _, noise = columns(16)
    log_scales[0], log_scales[1] = -23.0, 13.8
    quats[2] = 0
    logits = torch.full((16,), logit)
    exact = means.double() + shaped_noise(
        quats.double(), log_scales.double(), logits.double(), noise.double(), rate=1.0
    )
    CpuOperators().add_noise_(means, quats, log_scales, logits, noise, rate=1.0)
    torch.testing.assert_close(means.double(), exact, rtol=2e-5, atol=1e-6)


def test_any_number_of_threads_gives_the_same_bits(use_threads):
    results = []
    for threads in (1, 2, 5):
        use_threads(threads)
        means, *others = columns(20_000)
        CpuOperators().add_noise_(means, *others, rate=30.0)
        results.append(means)
    assert torch.equal(results[0], results[1])
    assert torch.equal(results[0], results[2])


def test_columns_that_lie_apart_in_memory_go_to_torch():
    means, quats, log_scales, logits, noise = columns(40)
    expected = means.clone()
    Operators().add_noise_(expected, quats, log_scales, logits, noise, rate=30.0)
    CpuOperators().add_noise_(means, quats, log_scales.T.contiguous().T, logits, noise, rate=30.0)
    assert torch.equal(means, expected)


def test_means_that_await_a_gradient_know_that_they_have_changed():
    means, *others = columns(40)
    means.requires_grad_()
    loss = means.square().sum()
    CpuOperators().add_noise_(means, *others, rate=30.0)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        loss.backward()
