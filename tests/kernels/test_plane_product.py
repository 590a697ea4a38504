"""Products of planes in kernels against plain torch in float64."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.calls import Calls, CountedLauncher
from support.field_tensors import agree, gradients, numbers, plane_tensors, product
from torch.autograd import forward_ad

from gsfw.core.operators import Operators
from gsfw.kernels.cuda.field_jobs import PLANE_LEVELS
from gsfw.kernels.cuda.operators import CudaOperators


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("rows", "channels", "sides"),
    [(1, 1, (2,)), (70, 3, (7, 12)), (150, 16, (7, 12)), (90, 32, (9,)), (33, 40, (2, 3, 5))],
)
def test_products_and_all_their_gradients_are_those_of_torch(
    operators_there, place, dtype, rows, channels, sides
):
    tensors = plane_tensors(2.2 * numbers(rows, 3, seed=0, dtype=dtype) - 1.1, channels, sides)
    agree(product, operators_there, tensors, place)


@settings(max_examples=25)
@given(st.integers(1, 40), st.integers(1, 35), st.integers(2, 9), st.integers(0, 2**31))
def test_any_sizes_agree_with_torch(operators_there, place, rows, channels, side, seed):
    places = 2.5 * numbers(rows, 3, seed=seed) - 1.25
    agree(product, operators_there, plane_tensors(places, channels, (side, side + 1)), place)


@pytest.mark.parametrize("side", [2, 5])
def test_places_on_cells_and_borders_agree_with_torch(operators_there, place, side):
    axis = torch.linspace(-1, 1, side, dtype=torch.float64)
    axis = torch.cat([axis, torch.tensor([-3.0, math.nextafter(1.0, 2.0), 1e30])])
    places = torch.cartesian_prod(axis, axis, axis)
    agree(product, operators_there, plane_tensors(places, 16, (side,)), place)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30, -1.0, 1.0])
def test_no_place_reads_or_writes_beyond_the_planes(operators_there, place, value):
    tensors = plane_tensors(torch.full((20, 3), value, dtype=torch.float64), 16)
    assert gradients(product, operators_there, tensors, place)[0].isfinite().all()
    if not math.isnan(value):  # torch has no cell for NaN.
        agree(product, operators_there, tensors, place)


def test_rows_without_a_gradient_are_left_out_of_the_backward_pass(operators_there, place):
    """NaN in the cells that only these rows read reaches no gradient."""
    tensors = plane_tensors(0.3 * numbers(50, 3, seed=0) + 0.6, 16)
    tensors[0][::3] = -0.9
    for table in tensors[1:]:
        table.flatten(0, 1)[0, :] = math.nan
        table[:, 0] = math.nan
    to_places = gradients(product, operators_there, tensors, place, silent=3)[1]
    assert not to_places[::3].any()
    assert to_places.isfinite().all()
    assert gradients(product, operators_there, tensors, place, silent=50)[1][3].isnan().any()


def test_a_product_and_its_gradients_take_a_launch_each():
    operators, launcher = counted()
    tensors = [tensor.requires_grad_() for tensor in plane_tensors(numbers(9, 3, seed=0), 4)]
    with Calls(launcher) as calls:
        product(operators, tensors)[0].sum().backward()
    assert calls.launches == ["plane_product<double>", "plane_product_backward<double>"]
    assert calls.operations.count("aten.new_zeros.default") == 1


def counted() -> tuple[CudaOperators, CountedLauncher]:
    """Operators on the emulation, and what they launch."""
    launcher = CountedLauncher()
    return CudaOperators(launcher), launcher


LEFT = {
    "no rows": plane_tensors(torch.zeros(0, 3), 4),
    "half precision": plane_tensors(torch.zeros(4, 3).half(), 4),
    "many resolutions": plane_tensors(numbers(4, 3, seed=0), 2, (2,) * (PLANE_LEVELS + 1)),
    "planes that are not square": [
        numbers(4, 3, seed=0), numbers(3, 4, 5, 2, seed=1), numbers(3, 5, 2, seed=2)
    ],
}  # fmt: skip


@pytest.mark.parametrize("case", LEFT)
def test_what_kernels_do_not_take_goes_to_torch(case):
    operators, launcher = counted()
    assert torch.equal(product(operators, LEFT[case])[0], product(Operators(), LEFT[case])[0])
    assert launcher.launches == []


@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated")  # Torch's own use of it.
def test_derivatives_carried_forward_are_left_to_torch():
    operators, launcher = counted()
    tensors = plane_tensors(numbers(4, 3, seed=0), 4)
    with forward_ad.dual_level():
        tensors[0] = forward_ad.make_dual(tensors[0], torch.ones_like(tensors[0]))
        with pytest.raises(RuntimeError):  # Torch's own interpolation has none either.
            product(operators, tensors)
    assert launcher.launches == []
