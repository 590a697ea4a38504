"""The fused step of Adam against plain torch."""

import pytest
import torch
from torch import Tensor

from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")

YES, NO = torch.tensor(True), torch.tensor(False)


def start(shape: tuple[int, ...], dtype: torch.dtype) -> tuple[Tensor, AdamMoments]:
    generator = torch.Generator().manual_seed(5)
    values = torch.randn(shape, dtype=dtype, generator=generator)
    return values, AdamMoments.zeros_like(values)


def gradients(values: Tensor, steps: int) -> list[Tensor]:
    generator = torch.Generator().manual_seed(6)
    return [
        torch.randn(values.shape, dtype=values.dtype, generator=generator) * 10.0 ** (step - 3)
        for step in range(steps)
    ]


def close(found: Tensor, expected: Tensor, largest: float) -> bool:
    """Within a few roundings of the largest term that was added."""
    return float((found - expected).abs().max()) <= 4 * torch.finfo(found.dtype).eps * largest


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("shape", [(), (5,), (1, 3), (37, 4), (300, 15, 3), (2000,)])
def test_a_few_steps_agree_with_torch(shape, dtype):
    values, moments = start(shape, dtype)
    others, other_moments = start(shape, dtype)
    eps = torch.finfo(dtype).eps
    for gradient in gradients(values, 4):
        CpuOperators().adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), YES)
        Operators().adam_([AdamUpdate(others, gradient, other_moments, 0.01)], AdamSettings(), YES)
    assert close(moments.first, other_moments.first, float(gradient.abs().max()))
    torch.testing.assert_close(moments.second, other_moments.second, rtol=16 * eps, atol=0.0)
    assert close(values, others, 1.0 + float(others.abs().max()))
    assert moments.count == 4


@pytest.mark.parametrize("shape", [(16_000, 3), (2000, 24), (1000, 16, 3)])
def test_whole_tables_are_stepped_as_one_row_of_numbers(shape):
    values, moments = start(shape, torch.float32)
    flat, flat_moments = start((48_000,), torch.float32)
    flat.copy_(values.flatten())
    for gradient in gradients(values, 2):
        CpuOperators().adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), YES)
        CpuOperators().adam_(
            [AdamUpdate(flat, gradient.flatten(), flat_moments, 0.01)], AdamSettings(), YES
        )
    assert torch.equal(values.flatten(), flat)
    assert torch.equal(moments.second.flatten(), flat_moments.second)


@pytest.mark.parametrize("width", [1, 3, 4, 24, 45])
def test_only_the_rows_that_are_named_change(width):
    values, moments = start((200, width), torch.float32)
    others, other_moments = start((200, width), torch.float32)
    rows = torch.arange(0, 200, 3).flip(0)
    untouched = torch.ones(200, dtype=torch.bool).index_fill(0, rows, False)
    before = values.clone()
    for gradient in gradients(values, 3):
        CpuOperators().adam_(
            [AdamUpdate(values, gradient, moments, 0.01, rows)], AdamSettings(), YES
        )
        Operators().adam_(
            [AdamUpdate(others, gradient, other_moments, 0.01, rows)], AdamSettings(), YES
        )
    assert torch.equal(values[untouched], before[untouched])
    assert not moments.first[untouched].any()
    assert not moments.second[untouched].any()
    torch.testing.assert_close(moments.second, other_moments.second, rtol=2e-6, atol=0.0)
    assert close(values, others, 1.0 + float(others.abs().max()))


@pytest.mark.parametrize("named", [False, True])
def test_bands_of_longer_rows_are_moved_where_they_lie(named):
    values, moments = start((100, 15, 3), torch.float32)
    before = values.clone()
    (gradient,) = gradients(values, 1)
    bands = AdamMoments(moments.first[:, :8], moments.second[:, :8], moments.count)
    rows = torch.arange(0, 100, 2) if named else None
    inner = values[:, :8]
    CpuOperators().adam_(
        [AdamUpdate(inner, gradient[:, :8], bands, 0.01, rows)], AdamSettings(), YES
    )
    assert torch.equal(values[:, 8:], before[:, 8:])
    assert not moments.second[:, 8:].any()
    assert moments.count == 1
    moved = values[rows, :8] if named else values[:, :8]
    expected = before - 0.01 * gradient.sign()  # Of a first step.
    torch.testing.assert_close(moved, expected[rows, :8] if named else expected[:, :8])
    if named:
        assert torch.equal(values[1::2], before[1::2])


def test_nothing_changes_after_a_step_that_was_not_finite():
    values, moments = start((50, 3), torch.float32)
    before = values.clone()
    gradient = torch.full_like(values, float("nan"))
    CpuOperators().adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), NO)
    assert torch.equal(values, before)
    assert moments.count == 0
    assert not moments.first.any()


def test_huge_gradients_leave_moments_finite():
    values, moments = start((50, 3), torch.float32)
    gradient = torch.full_like(values, 3e38)
    CpuOperators().adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), YES)
    assert moments.second.isfinite().all()
    assert values.isfinite().all()


def test_rows_without_gradient_or_momentum_stay_exactly():
    values, moments = start((50, 3), torch.float32)
    before = values.clone()
    CpuOperators().adam_(
        [AdamUpdate(values, torch.zeros_like(values), moments, 0.1)], AdamSettings(), YES
    )
    assert torch.equal(values, before)


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_any_number_of_threads_gives_the_same_bits(dtype, named, use_threads):
    results = []
    for threads in (1, 2, 5):
        use_threads(threads)
        values, moments = start((20_000, 7), dtype)
        rows = torch.arange(0, 20_000, 2) if named else None
        for gradient in gradients(values, 2):
            CpuOperators().adam_(
                [AdamUpdate(values, gradient, moments, 0.01, rows)], AdamSettings(), YES
            )
        results.append((values, moments.first, moments.second))
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


@pytest.mark.parametrize("turned", [False, True])
def test_what_native_code_does_not_take_goes_to_torch(turned):
    values = torch.ones(6, 4, dtype=torch.float32 if turned else torch.bfloat16)
    values = values.T if turned else values
    moments = AdamMoments.zeros_like(values)
    gradient = torch.ones_like(values)
    CpuOperators().adam_([AdamUpdate(values, gradient, moments, 0.5)], AdamSettings(), YES)
    assert torch.equal(values, torch.full_like(values, 0.5))


def test_a_graph_that_needs_the_old_values_notices_the_change():
    values, moments = start((5, 3), torch.float32)
    values.requires_grad_()
    squares = (values * values).sum()
    CpuOperators().adam_([AdamUpdate(values, torch.ones(5, 3), moments, 0.1)], AdamSettings(), YES)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        squares.backward()
