"""Native temporal fields against plain torch: products of planes, networks and regularisers."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.field_tensors import (
    agree,
    gradients,
    hash_tables,
    hashed,
    numbers,
    plane_tensors,
    product,
)
from support.states import assert_same_bits
from torch import Tensor

from gsfw.core.operators import Gate, Operators
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")

NATIVE, TORCH = CpuOperators(), Operators()
CPU = torch.device("cpu")


def network_tensors(rows: int, dtype: torch.dtype, sizes=(64, 32, 96)) -> list[Tensor]:
    """Inputs, two layers, and three heads."""
    inputs, width, last = sizes
    shapes = [(width, inputs), (last, width), *((outputs, last // 3) for outputs in (3, 1, 20))]
    tensors = [numbers(rows, inputs, seed=1, dtype=dtype) - 0.5]
    for seed, (outputs, given_) in enumerate(shapes):
        tensors.append((numbers(outputs, given_, seed=seed + 2, dtype=dtype) - 0.5) / 4)
        tensors.append(numbers(outputs, seed=seed + 9, dtype=dtype) - 0.5)
    return tensors


def network(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor, ...]:
    layers = list(zip(tensors[1::2], tensors[2::2], strict=True))
    return operators.relu_network(tensors[0], layers[:2], layers[2:])


def gated(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor, ...]:
    """The second head, of one value, says which rows need the others: about half of them."""
    layers = list(zip(tensors[1::2], tensors[2::2], strict=True))
    gate = Gate(1, limit(tensors).expand(len(tensors[0])))
    return operators.relu_network(tensors[0], layers[:2], layers[2:], gate)


@torch.no_grad()
def limit(tensors: list[Tensor]) -> Tensor:
    """A number in the middle of the second head's values, and equal to none of them."""
    values = network(TORCH, tensors)[1][:, 0].sort().values
    return values[len(values) // 2 :][:2].mean() - (1 if len(values) == 1 else 0)


def terms(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
    """Both regularisers of a grid."""
    variation = operators.squared_differences(tensors[0], (1, 2), 1, 0.3)
    return ((variation + operators.mean_distance(tensors[0], 0.5, 0.7))[None],)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("rows", [1, 64, 1100])
def test_networks_and_all_their_gradients_are_those_of_torch(dtype, rows):
    agree(network, NATIVE, network_tensors(rows, dtype), CPU, roundings=132.0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("rows", [1, 64, 1100])
def test_a_gate_leaves_out_the_other_heads_of_some_rows_and_their_gradients(dtype, rows):
    tensors = network_tensors(rows, dtype)
    agree(gated, NATIVE, tensors, CPU, roundings=132.0)
    found, (first, gate, last) = gated(NATIVE, tensors), network(NATIVE, tensors)
    shut = gate[:, 0] < limit(tensors)
    assert torch.equal(found[1], gate), "the head that decides is evaluated everywhere"
    for value, whole in ((found[0], first), (found[2], last)):
        assert not value[shut].any()
        assert torch.equal(value[~shut], whole[~shut]), "the same bits where it is open"


PLACES = 2 * numbers(3000, 3, seed=0, dtype=torch.float32) - 1
GRID = numbers(3, 70, 70, 16, seed=1, dtype=torch.float32)


@pytest.mark.parametrize(
    ("function", "tensors"),
    [
        (product, plane_tensors(PLACES, 32)),
        (hashed(PLACES), hash_tables(torch.float32, 4)),
        (network, network_tensors(3000, torch.float32)),
        (gated, network_tensors(3000, torch.float32)),
        (terms, [GRID]),
    ],
    ids=["planes", "hash grid", "network", "gated network", "regularisers"],
)
def test_results_are_the_same_bits_for_any_number_of_threads(function, tensors, use_threads):
    found = []
    for threads in (1, 2, 5):
        use_threads(threads)
        found.append(gradients(function, NATIVE, tensors, CPU))
    assert_same_bits(found[0], found[1])
    assert_same_bits(found[0], found[2])


def test_nan_passes_through_networks_as_in_torch():
    tensors = network_tensors(20, torch.float64)
    tensors[0][4, 7] = float("nan")
    for one, other in zip(network(NATIVE, tensors), network(TORCH, tensors), strict=True):
        assert torch.equal(one.isnan(), other.isnan())
        assert one.isnan().any()


def test_rows_without_a_number_pass_the_gate():
    tensors = network_tensors(20, torch.float64)
    tensors[0][4] = float("nan")
    layers = list(zip(tensors[1::2], tensors[2::2], strict=True))
    gate = Gate(1, torch.full((20,), 1e9, dtype=torch.float64))
    for kind in (NATIVE, TORCH):
        first, _, last = kind.relu_network(tensors[0], layers[:2], layers[2:], gate)
        for value in (first, last):
            assert value[4].isnan().all()
            assert not value[torch.arange(20) != 4].any()


def test_sizes_that_are_no_multiple_of_sixteen_are_left_to_torch():
    tensors = plane_tensors(2 * numbers(9, 3, seed=0) - 1, channels=6)
    assert_equal(product(NATIVE, tensors), product(TORCH, tensors))
    tensors = network_tensors(9, torch.float64, sizes=(20, 32, 96))
    assert_equal(network(NATIVE, tensors), network(TORCH, tensors))


def assert_equal(found: tuple[Tensor, ...], expected: tuple[Tensor, ...]) -> None:
    assert all(torch.equal(one, other) for one, other in zip(found, expected, strict=True))


def test_no_rows_have_no_features():
    assert product(NATIVE, plane_tensors(torch.zeros(0, 3), 32))[0].shape == (0, 64)


def test_heads_that_do_not_fit_the_trunk_are_refused():
    tensors = network_tensors(4, torch.float64)
    tensors[5] = tensors[5][:, :16].contiguous()
    with pytest.raises(ValueError, match="a layer does not fit"):
        network(NATIVE, tensors)


@settings(max_examples=30)
@given(st.integers(1, 70), st.integers(1, 40), st.integers(0, 2**31))
def test_any_number_of_rows_and_outputs_agrees_with_torch(rows, outputs, seed):
    inputs = numbers(rows, 16, seed=seed) - 0.5
    layer = (numbers(32, 16, seed=seed + 1) - 0.5, numbers(32, seed=seed + 2))
    heads = [(numbers(k, 16, seed=seed + k) - 0.5, numbers(k, seed=seed)) for k in (outputs, 1)]
    found = NATIVE.relu_network(inputs, [layer], heads)
    for one, other in zip(found, TORCH.relu_network(inputs, [layer], heads), strict=True):
        torch.testing.assert_close(one, other, atol=1e-13, rtol=1e-13)
