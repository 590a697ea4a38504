"""The fused step of Adam of all kernels against plain torch."""

import pytest
import torch
from support.adam_tables import gradients, start
from torch import Tensor

from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators

YES, NO = torch.tensor(True), torch.tensor(False)


def close(found: Tensor, expected: Tensor, largest: float) -> bool:
    """Within a few roundings of the largest term that was added."""
    return float((found - expected).abs().max()) <= 4 * torch.finfo(found.dtype).eps * largest


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("shape", [(), (5,), (1, 3), (37, 4), (300, 15, 3), (2050,)])
def test_a_few_steps_agree_with_torch(operators, shape, dtype):
    values, moments = start(shape, dtype)
    others, other_moments = start(shape, dtype)
    eps = torch.finfo(dtype).eps
    for gradient in gradients(values, 4):
        operators.adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), YES)
        Operators().adam_([AdamUpdate(others, gradient, other_moments, 0.01)], AdamSettings(), YES)
    assert close(moments.first, other_moments.first, float(gradient.abs().max()))
    torch.testing.assert_close(moments.second, other_moments.second, rtol=16 * eps, atol=0.0)
    assert close(values, others, 1.0 + float(others.abs().max()))
    assert moments.count == 4


def test_arrays_that_begin_anywhere_are_stepped_too(operators):
    values, moments = start((41,), torch.float32)
    others, other_moments = start((41,), torch.float32)
    (gradient,) = gradients(values, 1)
    shifted = AdamMoments(moments.first[1:], moments.second[1:], moments.count)
    operators.adam_([AdamUpdate(values[1:], gradient[1:], shifted, 0.01)], AdamSettings(), YES)
    Operators().adam_([AdamUpdate(others, gradient, other_moments, 0.01)], AdamSettings(), YES)
    assert values[0] != others[0]
    assert close(values[1:], others[1:], 1.0)


@pytest.mark.parametrize("width", [1, 3, 4, 24, 45])
def test_only_the_rows_that_are_named_change(operators, width):
    values, moments = start((200, width), torch.float32)
    others, other_moments = start((200, width), torch.float32)
    rows = torch.arange(0, 200, 3).flip(0)
    untouched = torch.ones(200, dtype=torch.bool).index_fill(0, rows, False)
    before = values.clone()
    for gradient in gradients(values, 3):
        operators.adam_([AdamUpdate(values, gradient, moments, 0.01, rows)], AdamSettings(), YES)
        Operators().adam_(
            [AdamUpdate(others, gradient, other_moments, 0.01, rows)], AdamSettings(), YES
        )
    assert torch.equal(values[untouched], before[untouched])
    assert not moments.first[untouched].any()
    assert not moments.second[untouched].any()
    torch.testing.assert_close(moments.second, other_moments.second, rtol=2e-6, atol=0.0)
    assert close(values, others, 1.0 + float(others.abs().max()))


def test_rows_may_be_longer_than_a_block_steps(operators):
    values, moments = start((3, 2500), torch.float32)
    before = values.clone()
    (gradient,) = gradients(values, 1)
    rows = torch.tensor([2, 0])
    operators.adam_([AdamUpdate(values, gradient, moments, 0.01, rows)], AdamSettings(), YES)
    expected = before - 0.01 * gradient.sign()  # Of a first step.
    torch.testing.assert_close(values[rows], expected[rows])
    assert torch.equal(values[1], before[1])


def test_no_rows_are_still_a_step(operators):
    values, moments = start((9, 3), torch.float32)
    before = values.clone()
    rows = torch.zeros(0, dtype=torch.int64)
    operators.adam_([AdamUpdate(values, values, moments, 0.01, rows)], AdamSettings(), YES)
    assert torch.equal(values, before)
    assert moments.count == 1


@pytest.mark.parametrize("named", [False, True])
def test_bands_of_longer_rows_are_moved_where_they_lie(operators, named):
    values, moments = start((100, 15, 3), torch.float32)
    before = values.clone()
    (gradient,) = gradients(values, 1)
    bands = AdamMoments(moments.first[:, :8], moments.second[:, :8], moments.count)
    rows = torch.arange(0, 100, 2) if named else None
    inner = values[:, :8]
    operators.adam_([AdamUpdate(inner, gradient[:, :8], bands, 0.01, rows)], AdamSettings(), YES)
    assert torch.equal(values[:, 8:], before[:, 8:])
    assert not moments.second[:, 8:].any()
    assert moments.count == 1
    moved = values[rows, :8] if named else values[:, :8]
    expected = before - 0.01 * gradient.sign()  # Of a first step.
    torch.testing.assert_close(moved, expected[rows, :8] if named else expected[:, :8])
    if named:
        assert torch.equal(values[1::2], before[1::2])


@pytest.mark.parametrize("first", [False, True])
def test_nothing_changes_after_a_step_that_was_not_finite(operators, first):
    values, moments = start((50, 3), torch.float32)
    if not first:
        operators.adam_([AdamUpdate(values, values.clone(), moments, 0.01)], AdamSettings(), YES)
    before = [tensor.clone() for tensor in (values, moments.first, moments.second, moments.count)]
    gradient = torch.full_like(values, float("nan"))
    operators.adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), NO)
    after = (values, moments.first, moments.second, moments.count)
    assert all(torch.equal(old, new) for old, new in zip(before, after, strict=True))


def test_huge_gradients_leave_moments_finite(operators):
    values, moments = start((50, 3), torch.float32)
    gradient = torch.full_like(values, 3e38)
    operators.adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), YES)
    assert moments.second.isfinite().all()
    assert values.isfinite().all()


def test_rows_without_gradient_or_momentum_stay_exactly(operators):
    values, moments = start((50, 3), torch.float32)
    before = values.clone()
    operators.adam_(
        [AdamUpdate(values, torch.zeros_like(values), moments, 0.1)], AdamSettings(), YES
    )
    assert torch.equal(values, before)


@pytest.mark.parametrize("turned", [False, True])
def test_what_kernels_do_not_take_goes_to_torch(operators, turned):
    values = torch.ones(6, 4, dtype=torch.float32 if turned else torch.bfloat16)
    values = values.T if turned else values
    moments = AdamMoments.zeros_like(values)
    gradient = torch.ones_like(values)
    operators.adam_([AdamUpdate(values, gradient, moments, 0.5)], AdamSettings(), YES)
    assert torch.equal(values, torch.full_like(values, 0.5))


def test_a_graph_that_needs_the_old_values_notices_the_change(operators):
    values, moments = start((5, 3), torch.float32)
    values.requires_grad_()
    squares = (values * values).sum()
    operators.adam_([AdamUpdate(values, torch.ones(5, 3), moments, 0.1)], AdamSettings(), YES)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        squares.backward()
