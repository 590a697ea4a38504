"""Features of hash grids in kernels against plain torch in float64."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.calls import Calls, CountedLauncher
from support.field_tensors import HASH_SIZES, agree, hash_tables, hashed, numbers

from gsfw.core.maths.hash_features import PRIMES
from gsfw.core.operators import Operators
from gsfw.kernels.cuda.field_jobs import HASH_LEVELS
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.kernels.cuda.source_files import source_text


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("channels", [1, 2, 3, 4, 6, 8])
def test_features_and_their_gradients_are_those_of_torch(operators_there, place, dtype, channels):
    # In float32 a place may round into the next cell, where the weights of torch are as continuous.
    places = (2.2 * numbers(150, 3, seed=0, dtype=torch.float32) - 1.1).double()
    agree(hashed(places), operators_there, hash_tables(dtype, channels), place, roundings=256.0)


@settings(max_examples=20)
@given(
    st.integers(1, 30), st.integers(1, 5), st.integers(2, 50), st.integers(2, 9), st.floats(-1, 2)
)
def test_any_sizes_agree_with_torch(operators_there, place, rows, channels, side, times, time):
    places = 2.5 * numbers(rows, 3, seed=rows) - 1.25
    function = hashed(places, time, ((side, times),))
    agree(function, operators_there, [numbers(256, channels, seed=side)], place)


@pytest.mark.parametrize("time", [-1.0, 0.0, 0.5, 1.0, 7.0])
def test_places_and_times_on_corners_and_borders_agree_with_torch(operators_there, place, time):
    axis = torch.linspace(-1, 1, 5, dtype=torch.float64)
    axis = torch.cat([axis, torch.tensor([-3.0, math.nextafter(1.0, 2.0), 1e30])])
    places = torch.cartesian_prod(axis, axis[::2], axis[::3])
    agree(hashed(places, time), operators_there, hash_tables(torch.float64, 2), place)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1e30])
def test_nothing_reads_beyond_the_tables(operators_there, place, value):
    tables = [table.to(place) for table in hash_tables(torch.float64, 4)]
    nowhere = torch.full((20, 3), value, dtype=torch.float64)
    assert hashed(nowhere)(operators_there, tables)[0].isfinite().all()
    assert hashed(torch.zeros(9, 3), value)(operators_there, tables)[0].isfinite().all()
    assert hashed(nowhere)(Operators(), tables)[0].shape == (20, 12)


def test_features_and_their_gradients_take_a_launch_each():
    launcher = CountedLauncher()
    tables = [table.requires_grad_() for table in hash_tables(torch.float64, 6)]
    with Calls(launcher) as calls:
        hashed(numbers(9, 3, seed=0))(CudaOperators(launcher), tables)[0].sum().backward()
    assert calls.launches == ["hash_features<double, 2>", "hash_features_backward<double, 2>"]
    assert calls.operations.count("aten.new_zeros.default") == 1


def test_tables_that_begin_anywhere_or_lie_apart_are_taken_too(operators_there, place):
    function = hashed(2 * numbers(30, 3, seed=0) - 1)
    tables = hash_tables(torch.float32, 4)
    shifted = [torch.cat([t.new_zeros(1), t.flatten()])[1:].view_as(t) for t in tables]
    apart = [t.T.contiguous().T for t in tables]
    (expected,) = function(operators_there, [t.to(place) for t in tables])
    for others in (shifted, apart):
        (found,) = function(operators_there, [t.to(place) for t in others])
        torch.testing.assert_close(found, expected)
        agree(function, operators_there, others, place, roundings=256.0)


def test_places_have_no_gradient_as_in_torch(operators_of):
    places = numbers(5, 3, seed=0).requires_grad_()
    time, tables = numbers(1, seed=1)[0].requires_grad_(), hash_tables(torch.float64, 4)
    assert not operators_of(0).hash_features(places, time, tables, HASH_SIZES).requires_grad


LEFT = {
    "no rows": (torch.zeros(0, 3), hash_tables(torch.float32, 4), HASH_SIZES),
    "half precision": (
        numbers(4, 3, seed=0).bfloat16(), hash_tables(torch.bfloat16, 4), HASH_SIZES
    ),
    "more corners than float32 counts": (
        numbers(4, 3, seed=0), [numbers(64, 1, seed=1)], ((2**24 + 1, 2),)
    ),
    "many resolutions": (
        numbers(4, 3, seed=0), [numbers(64, 1, seed=1)] * (HASH_LEVELS + 1),
        ((2, 2),) * (HASH_LEVELS + 1),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LEFT)
def test_what_kernels_do_not_take_goes_to_torch(case):
    launcher = CountedLauncher()
    places, tables, sizes = LEFT[case]
    found, expected = (
        kind.hash_features(places, torch.tensor(0.3), tables, sizes)
        for kind in (CudaOperators(launcher), Operators())
    )
    assert torch.equal(found, expected)
    assert launcher.launches == []


def test_the_kernels_know_the_factors_of_the_hash():
    factors = ", ".join(f"{prime}u" for prime in PRIMES)
    assert f"{{{factors}}}" in source_text("hash_features.cu")
