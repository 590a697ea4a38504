"""Slices of Gaussians of space and time in kernels against plain torch in float64."""

import math

import pytest
import torch
from support.calls import Calls, CountedLauncher
from support.field_tensors import agree, gradients, quaternions_and_scales, sliced
from torch import Tensor

from gsfw.core.operators import Operators
from gsfw.kernels.cuda.operators import CudaOperators

CPU = torch.device("cpu")


@pytest.mark.parametrize("rows", [1, 128, 333])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_slices_and_their_gradients_are_those_of_torch(operators_there, place, rows, dtype):
    agree(
        sliced,
        operators_there,
        quaternions_and_scales(rows, dtype, -1.0, 0.0),
        place,
        roundings=200.0,
    )


@pytest.mark.unchecked
def test_rows_that_are_no_quaternions_are_refused_as_by_torch():
    launcher, rows = CountedLauncher(), torch.rand(5, 3)
    for operators in (CudaOperators(launcher), Operators()):
        with pytest.raises((RuntimeError, ValueError)):
            operators.slices(rows, rows, rows)
    assert launcher.launches == []


@pytest.mark.parametrize(("low", "high"), [(-9.0, 2.0), (-3.0, 18.0), (-18.0, 0.0)])
def test_slices_in_float32_keep_their_digits_at_extreme_scales(operators_there, place, low, high):
    left, right, logs = quaternions_and_scales(2000, torch.float32, low, high)
    there = [tensor.to(place) for tensor in (left, right, logs.exp())]
    tensors = [left.double(), right.double(), logs.exp().double()]
    slices = operators_there.slices(*there), Operators().slices(*tensors), sensitivity(tensors)
    for found, true, moved in zip(*slices, strict=True):
        size = true.abs().view(2000, -1).amax(1)
        errors = (found.cpu() - true).abs().view(2000, -1).amax(1)
        assert float((errors / size).median()) < 1e-6
        assert bool((errors <= 8 * (moved + torch.finfo(torch.float32).eps * size)).all())


def sensitivity(tensors: list[Tensor]) -> list[Tensor]:
    """Largest change of each row's slices when inputs are off by roundings of float32."""
    exact, eps, changes = Operators().slices(*tensors), torch.finfo(torch.float32).eps, []
    for seed in range(16):
        generator = torch.Generator().manual_seed(seed)
        signs = (torch.randint(2, t.shape, generator=generator) * 2.0 - 1.0 for t in tensors)
        off = Operators().slices(*(t * (1 + eps * s) for t, s in zip(tensors, signs, strict=True)))
        changes.append([(a - b).abs() for a, b in zip(off, exact, strict=True)])
    stacked = (torch.stack(of).amax(0) for of in zip(*changes, strict=True))
    return [change.view(len(change), -1).amax(1) for change in stacked]


@pytest.mark.parametrize("length", [0.0, 1e-13, 1e-11, 1e-20, 1e15])
def test_quaternions_of_any_norm_are_those_of_torch(operators_there, place, length):
    tensors = quaternions_and_scales(20, torch.float64)
    tensors[0][4] *= length
    tensors[1][5] *= length
    found = gradients(sliced, operators_there, tensors, place)
    expected = gradients(sliced, Operators(), tensors, CPU)
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12 * float(other.abs().max()))
    if length < 1e-12:
        assert not found[3][4].any()


def test_nan_passes_or_is_the_identity_as_in_torch(operators_there, place):
    for tensor, component in ((0, 0), (0, 2), (1, 3), (2, 3)):
        tensors = quaternions_and_scales(20, torch.float64)
        tensors[tensor][4, component] = math.nan
        found = sliced(operators_there, [t.to(place) for t in tensors])
        for one, other in zip(found, sliced(Operators(), tensors), strict=True):
            torch.testing.assert_close(one.cpu(), other, rtol=1e-9, atol=1e-12, equal_nan=True)


def test_covariances_are_symmetric_to_the_bit(operators_there, place):
    found = sliced(
        operators_there, [t.to(place) for t in quaternions_and_scales(100, torch.float32)]
    )[0]
    assert torch.equal(found, found.transpose(1, 2))


def test_slices_and_their_gradients_take_a_launch_each():
    launcher = CountedLauncher()
    tensors = [tensor.requires_grad_() for tensor in quaternions_and_scales(9, torch.float32)]
    with Calls(launcher) as calls:
        covariances, _, variances = CudaOperators(launcher).slices(*tensors)
        (covariances.sum() + variances.sum()).backward()
    assert calls.launches == ["slice<float>", "slice_backward<float>"]
    assert all(tensor.grad.any() for tensor in tensors)


@pytest.mark.parametrize(
    "tensors", [quaternions_and_scales(0, torch.float32), quaternions_and_scales(4, torch.bfloat16)]
)
def test_what_kernels_do_not_take_goes_to_torch(tensors):
    launcher = CountedLauncher()
    found = sliced(CudaOperators(launcher), tensors)
    for one, other in zip(found, sliced(Operators(), tensors), strict=True):
        assert torch.equal(one, other)
    assert launcher.launches == []
