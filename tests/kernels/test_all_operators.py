"""What the kernels of all operators do in torch's autograd, and in any order of threads."""

import pytest
import torch
from support.calls import CountedLauncher
from support.field_tensors import (
    distance,
    gradients,
    hash_tables,
    hashed,
    numbers,
    plane_tensors,
    product,
    quaternions_and_scales,
    sliced,
    variation,
)
from support.losses import images
from torch import Tensor
from torch.autograd import forward_ad

from gsfw.core.loop.determinism import deterministic
from gsfw.core.operators import Operators
from gsfw.kernels.cuda.operators import CudaOperators

CPU = torch.device("cpu")
PLACES = 2 * numbers(30, 3, seed=0) - 1
RENDERED, TARGET, _ = images((1, 6, 6, 1), torch.float64)


def unlikeness(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
    return (operators.l1_dssim(tensors[0], TARGET)[1],)


SUMS = {
    "planes": (product, plane_tensors(PLACES, 8)),
    "hash grids": (hashed(PLACES), hash_tables(torch.float64, 4)),
}
BOTH_WAYS = {
    "slices": (sliced, quaternions_and_scales(5, torch.float64)),
    "distances": (distance, [numbers(9, seed=1)]),
    "losses": (unlikeness, [RENDERED.detach()]),
}
"""Operators that torch also differentiates forward."""
REFUSED_TWICE = {
    "planes": SUMS["planes"],
    "differences": (variation((0, 1), 1), [numbers(4, 5, 6, seed=1)]),
}
ALL = {**SUMS, **BOTH_WAYS, **REFUSED_TWICE}


def leaves(name: str, place: torch.device = CPU) -> list[Tensor]:
    return [tensor.detach().clone().to(place).requires_grad_() for tensor in ALL[name][1]]


def total(name: str, operators: Operators, tensors: list[Tensor]) -> Tensor:
    return torch.stack([part.square().sum() for part in ALL[name][0](operators, tensors)]).sum()


@pytest.mark.parametrize("name", ALL)
def test_backward_may_run_twice(operators, name):
    tensors = leaves(name)
    value = total(name, operators, tensors)
    first = torch.autograd.grad(value, tensors, retain_graph=True)
    torch.testing.assert_close(torch.autograd.grad(value, tensors), first)


@pytest.mark.parametrize("name", ["slices", "distances"])
def test_second_derivatives_come_from_torch(operators_of, name):
    second, tensors = [], leaves(name)
    for kind in (operators_of(0), Operators()):
        first = torch.autograd.grad(total(name, kind, tensors), tensors, create_graph=True)
        second.append(torch.autograd.grad(sum(part.square().sum() for part in first), tensors))
    torch.testing.assert_close(*second)


@pytest.mark.parametrize("name", REFUSED_TWICE)
def test_a_second_derivative_is_refused_as_torch_does(operators, name):
    tensors = leaves(name)
    for kind in (operators, Operators()):
        value = total(name, kind, tensors)
        (gradient,) = torch.autograd.grad(value, tensors[0], create_graph=True)
        with pytest.raises(RuntimeError, match="differentiate twice"):
            gradient.sum().backward()


@pytest.mark.parametrize("name", BOTH_WAYS)
@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated")  # Torch's own use of it.
def test_derivatives_carried_forward_come_from_torch(operators, name):
    function, (first, *others) = BOTH_WAYS[name]
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(first, numbers(*first.shape, seed=4))
        assert forward_ad.unpack_dual(function(operators, [dual, *others])[0]).tangent.any()


@pytest.mark.parametrize("name", ALL)
def test_only_gradients_that_are_wanted_are_made(operators_there, place, name):
    for wanted in range(len(ALL[name][1])):
        tensors = [tensor.detach().clone().to(place) for tensor in ALL[name][1]]
        leaf = tensors[wanted].requires_grad_()
        found, expected = (
            torch.autograd.grad(total(name, kind, tensors), leaf)[0]
            for kind in (operators_there, Operators())
        )
        torch.testing.assert_close(found, expected)


@pytest.mark.parametrize("name", ["planes", "slices", "differences"])
def test_tensors_that_are_not_contiguous_are_taken_too(operators_there, place, name):
    turned = [tensor.transpose(0, 1).contiguous().transpose(0, 1) for tensor in ALL[name][1]]
    found = ALL[name][0](operators_there, [tensor.to(place) for tensor in turned])
    for one, other in zip(found, ALL[name][0](Operators(), ALL[name][1]), strict=True):
        torch.testing.assert_close(one.cpu(), other)


@pytest.mark.parametrize("name", SUMS)
def test_deterministic_algorithms_are_those_of_torch(name):
    (function, tensors), launcher = SUMS[name], CountedLauncher()
    with deterministic(CPU):
        (found,) = function(CudaOperators(launcher), tensors)
    assert torch.equal(found, function(Operators(), tensors)[0])
    assert launcher.launches == []


@pytest.mark.parametrize(("name", "without_sums"), [("planes", 2), ("hash grids", 1)])
def test_any_order_of_threads_gives_the_same_sums_but_for_rounding(
    operators_of, name, without_sums
):
    """Features have no sums, and gradients of places neither."""
    function, tensors = SUMS[name]
    first, *others = (gradients(function, operators_of(seed), tensors, CPU) for seed in (0, 1, 2))
    for other in others:
        assert all(map(torch.equal, first[:without_sums], other[:without_sums]))
        torch.testing.assert_close(first, other, rtol=1e-12, atol=1e-12)
