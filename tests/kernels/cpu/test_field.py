"""Native temporal fields against plain torch: products of planes, networks and regularisers."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.field_tensors import numbers, quaternions_and_scales, sliced
from torch import Tensor

from gsfw.core.operators import Gate, Operators
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")

NATIVE, TORCH = CpuOperators(), Operators()
SIDES = (7, 12)


def planes(places: Tensor, channels: int = 32) -> list[Tensor]:
    """Places, planes of two resolutions, and lines of two resolutions."""
    dtype = places.dtype
    return [
        places,
        *(numbers(3, s, s, channels, seed=s, dtype=dtype) + 0.5 for s in SIDES),
        *(numbers(3, s, channels, seed=s + 1, dtype=dtype) + 0.5 for s in SIDES),
    ]


def product(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
    return (operators.plane_product(tensors[0], tensors[1:3], tensors[3:], 1.7),)


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


def results(function, operators: Operators, tensors: list[Tensor], silent: int = 3):
    """Outputs and all gradients; every ``silent``-th row has an incoming gradient of zero."""
    leaves = [tensor.clone().requires_grad_() for tensor in tensors]
    outputs = function(operators, leaves)
    flows = [numbers(*o.shape, seed=20 + i, dtype=o.dtype) for i, o in enumerate(outputs)]
    for flow in flows:
        flow[::silent] = 0
    torch.autograd.backward(outputs, flows)
    return [output.detach() for output in outputs] + [leaf.grad for leaf in leaves]


def assert_agree(found: list[Tensor], expected: list[Tensor], terms: int) -> None:
    """Within the rounding of sums of so many terms."""
    for one, other in zip(found, expected, strict=True):
        scale = float(other.abs().max()) * torch.finfo(other.dtype).eps
        assert float((one - other).abs().max()) <= 4 * terms**0.5 * scale


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("channels", [16, 32])
def test_products_of_planes_and_all_their_gradients_are_those_of_torch(dtype, channels):
    tensors = planes(2.2 * numbers(1100, 3, seed=0, dtype=dtype) - 1.1, channels)
    found, expected = (results(product, kind, tensors) for kind in (NATIVE, TORCH))
    assert_agree(found, expected, terms=1100)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("rows", [1, 64, 1100])
def test_networks_and_all_their_gradients_are_those_of_torch(dtype, rows):
    tensors = network_tensors(rows, dtype)
    found, expected = (results(network, kind, tensors, 2) for kind in (NATIVE, TORCH))
    assert_agree(found, expected, terms=1100)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("rows", [1, 64, 1100])
def test_a_gate_leaves_out_the_other_heads_of_some_rows_and_their_gradients(dtype, rows):
    tensors = network_tensors(rows, dtype)
    found, expected = (results(gated, kind, tensors, 2) for kind in (NATIVE, TORCH))
    assert_agree(found, expected, terms=1100)
    first, gate, last = network(NATIVE, tensors)
    shut = gate[:, 0] < limit(tensors)
    assert torch.equal(found[1], gate), "the head that decides is evaluated everywhere"
    for value, whole in ((found[0], first), (found[2], last)):
        assert not value[shut].any()
        assert torch.equal(value[~shut], whole[~shut]), "the same bits where it is open"


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


@pytest.mark.parametrize("function", [product, network, gated])
def test_results_are_the_same_bits_for_any_number_of_threads(function, use_threads):
    tensors = (
        planes(2 * numbers(3000, 3, seed=0, dtype=torch.float32) - 1)
        if function is product
        else network_tensors(3000, torch.float32)
    )
    found = []
    for threads in (1, 2, 5):
        use_threads(threads)
        found.append(results(function, NATIVE, tensors))
    for other in found[1:]:
        assert all(torch.equal(one, two) for one, two in zip(found[0], other, strict=True))


def test_rows_without_a_gradient_are_left_out_of_the_backward_pass():
    """NaN in the cells that only these rows read reaches no gradient."""
    tensors = planes(0.3 * numbers(50, 3, seed=0) + 0.6)
    tensors[0][::3] = -0.9
    for table in tensors[1:]:
        table.flatten(0, 1)[0, :] = float("nan")
        table[:, 0] = float("nan")
    to_places = results(product, NATIVE, tensors)[1]
    assert not to_places[::3].any()
    assert to_places.isfinite().all()
    assert results(product, NATIVE, tensors, silent=50)[1][3].isnan().any()


def test_nan_passes_through_networks_and_slices_as_in_torch():
    tensors = network_tensors(20, torch.float64)
    tensors[0][4, 7] = float("nan")
    for one, other in zip(network(NATIVE, tensors), network(TORCH, tensors), strict=True):
        assert torch.equal(one.isnan(), other.isnan())
        assert one.isnan().any()
    tensors = quaternions_and_scales(20, torch.float64, -3.0, 0.0)
    tensors[2][4, 3] = float("nan")
    assert all(found[4].isnan().all() for found in sliced(NATIVE, tensors))
    for component in range(4):
        tensors = quaternions_and_scales(20, torch.float64, -3.0, 0.0)
        tensors[0][4, component] = float("nan")
        for one, other in zip(sliced(NATIVE, tensors), sliced(TORCH, tensors), strict=True):
            torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12)


def test_regularisers_of_large_grids_are_the_same_bits_for_any_number_of_threads(use_threads):
    grid = [numbers(3, 70, 70, 16, seed=1, dtype=torch.float32)]

    def terms(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
        variation = operators.squared_differences(tensors[0], (1, 2), 1, 0.3)
        return ((variation + operators.mean_distance(tensors[0], 0.5, 0.7))[None],)

    found = []
    for threads in (1, 2, 5):
        use_threads(threads)
        found.append(results(terms, NATIVE, grid, silent=2))
    assert all(torch.equal(one, two) for one, two in zip(found[0], found[1], strict=True))
    assert all(torch.equal(one, two) for one, two in zip(found[0], found[2], strict=True))
    assert_agree(found[0], results(terms, TORCH, grid, silent=2), terms=grid[0].numel())


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 1e30, -1.0, 1.0])
def test_no_place_reads_or_writes_beyond_the_planes(value):
    tensors = planes(torch.full((20, 3), value, dtype=torch.float64))
    found = results(product, NATIVE, tensors)
    assert found[0].isfinite().all()
    if not math.isnan(value):  # torch has no cell for NaN.
        assert_agree(found, results(product, TORCH, tensors), terms=20)


def test_sizes_that_are_no_multiple_of_sixteen_are_left_to_torch():
    tensors = planes(2 * numbers(9, 3, seed=0) - 1, channels=6)
    assert_equal(product(NATIVE, tensors), product(TORCH, tensors))
    tensors = network_tensors(9, torch.float64, sizes=(20, 32, 96))
    assert_equal(network(NATIVE, tensors), network(TORCH, tensors))


def assert_equal(found: tuple[Tensor, ...], expected: tuple[Tensor, ...]) -> None:
    assert all(torch.equal(one, other) for one, other in zip(found, expected, strict=True))


def test_no_rows_have_no_features():
    assert product(NATIVE, planes(torch.zeros(0, 3)))[0].shape == (0, 64)


def test_heads_that_do_not_fit_the_trunk_are_refused():
    tensors = network_tensors(4, torch.float64)
    tensors[5] = tensors[5][:, :16].contiguous()
    with pytest.raises(ValueError, match="a layer does not fit"):
        network(NATIVE, tensors)


SIZES = ((5, 3), (9, 4), (40, 7))


def hashed(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
    time = torch.tensor(0.3, dtype=torch.float64)
    return (operators.hash_features(tensors[0].detach(), time, tensors[1:], SIZES),)


def hash_tables(rows: int, dtype: torch.dtype, channels: int = 4) -> list[Tensor]:
    """Places, two tables with a row for each corner, and one with a hash."""
    tables = [
        numbers(count, channels, seed=i, dtype=dtype) for i, count in enumerate((375, 4096, 1024))
    ]
    return [2.2 * numbers(rows, 3, seed=0, dtype=dtype) - 1.1, *tables]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("channels", [1, 4, 6])
def test_hash_features_and_their_gradients_are_those_of_torch(dtype, channels):
    tensors = hash_tables(700, dtype, channels)

    def with_places(operators: Operators, given_: list[Tensor]) -> tuple[Tensor]:
        return hashed(operators, [tensors[0], *given_])

    found, expected = (results(with_places, kind, tensors[1:]) for kind in (NATIVE, TORCH))
    assert_agree(found, expected, terms=700)


def test_hash_features_are_the_same_bits_for_any_number_of_threads(use_threads):
    places, *tables = hash_tables(3000, torch.float32)
    found = []
    for threads in (1, 2, 5):
        use_threads(threads)
        found.append(results(lambda o, t: hashed(o, [places, *t]), NATIVE, tables))
    assert all(torch.equal(one, two) for one, two in zip(found[0], found[1], strict=True))
    assert all(torch.equal(one, two) for one, two in zip(found[0], found[2], strict=True))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e30])
def test_no_place_reads_beyond_the_tables(value):
    places, *tables = hash_tables(20, torch.float64)
    assert hashed(NATIVE, [torch.full_like(places, value), *tables])[0].isfinite().all()


@pytest.mark.parametrize("rows", [1, 16, 333])
def test_slices_and_their_gradients_are_those_of_torch(rows):
    tensors = quaternions_and_scales(rows, torch.float64, -3.0, 0.0)
    found, expected = (results(sliced, kind, tensors) for kind in (NATIVE, TORCH))
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12 * float(other.abs().max()))


@pytest.mark.parametrize(("low", "high"), [(-9.0, 2.0), (-3.0, 18.0), (-18.0, 0.0)])
def test_slices_in_float32_keep_their_digits_at_extreme_scales(low, high):
    left, right, logs = quaternions_and_scales(2000, torch.float32, low, high)
    given_ = [left.double(), right.double(), logs.exp().double()]
    found, exact = sliced(NATIVE, [left, right, logs]), TORCH.slices(*given_)
    for one, true, moved in zip(found, exact, sensitivity(given_), strict=True):
        size = true.abs().view(2000, -1).amax(1)
        errors = (one - true).abs().view(2000, -1).amax(1)
        assert float((errors / size).median()) < 1e-6
        assert bool((errors <= 8 * (moved + torch.finfo(torch.float32).eps * size)).all())


def sensitivity(tensors: list[Tensor]) -> list[Tensor]:
    """Largest change of each row's slices when inputs are off by roundings of float32."""
    exact, eps, changes = TORCH.slices(*tensors), torch.finfo(torch.float32).eps, []
    for seed in range(16):
        generator = torch.Generator().manual_seed(seed)
        signs = (torch.randint(2, t.shape, generator=generator) * 2.0 - 1.0 for t in tensors)
        off = TORCH.slices(*(t * (1 + eps * s) for t, s in zip(tensors, signs, strict=True)))
        changes.append([(a - b).abs() for a, b in zip(off, exact, strict=True)])
    stacked = (torch.stack(of).amax(0) for of in zip(*changes, strict=True))
    return [change.view(len(change), -1).amax(1) for change in stacked]


def test_a_quaternion_near_zero_is_the_identity_without_gradient():
    tensors = quaternions_and_scales(20, torch.float64, -3.0, 0.0)
    tensors[0][4] = 1e-13
    found, expected = (results(sliced, kind, tensors) for kind in (NATIVE, TORCH))
    assert not found[3][4].any()
    assert_agree(found[:3], expected[:3], terms=400)


VARIATIONS = [
    ((3, 7, 9, 32), (1, 2), 1), ((25, 3, 6, 32), (0,), 2), ((25, 3, 6, 5), (0,), 1),
    ((2, 3, 6, 5), (0,), 2), ((4, 5, 6), (2,), 2), ((1, 4, 4, 3), (0, 1), 1),
    ((4, 5, 6), (-2, -1), 1),
]  # fmt: skip


@pytest.mark.parametrize(("shape", "axes", "order"), VARIATIONS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_regularisers_of_grids_and_their_gradients_are_those_of_torch(shape, axes, order, dtype):
    def terms(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
        variation = operators.squared_differences(tensors[0], axes, order, 0.3)
        return ((variation + 2 * operators.mean_distance(tensors[0], 0.5, 0.7))[None],)

    grid = [numbers(*shape, seed=3, dtype=dtype)]
    found, expected = (results(terms, kind, grid, silent=2) for kind in (NATIVE, TORCH))
    assert_agree(found, expected, terms=grid[0].numel())


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 70), st.integers(1, 40), st.integers(0, 2**31))
def test_any_number_of_rows_and_outputs_agrees_with_torch(rows, outputs, seed):
    inputs = numbers(rows, 16, seed=seed) - 0.5
    layer = (numbers(32, 16, seed=seed + 1) - 0.5, numbers(32, seed=seed + 2))
    heads = [(numbers(k, 16, seed=seed + k) - 0.5, numbers(k, seed=seed)) for k in (outputs, 1)]
    found = NATIVE.relu_network(inputs, [layer], heads)
    for one, other in zip(found, TORCH.relu_network(inputs, [layer], heads), strict=True):
        torch.testing.assert_close(one, other, atol=1e-13, rtol=1e-13)
