"""The box of nearly all Gaussians."""

import pytest
import torch

from gsfw.core.maths.inner_box import inner_box


def cube(count: int = 1000) -> torch.Tensor:
    return 2.0 * torch.rand(count, 3, generator=torch.Generator().manual_seed(0)) - 1.0


def test_nearly_all_gaussians_are_within_the_box():
    low, high = inner_box(cube())
    assert torch.allclose(low, torch.full((3,), -0.96).double(), atol=0.03)
    assert torch.allclose(high, torch.full((3,), 0.96).double(), atol=0.03)


def test_a_sky_of_a_fifth_as_many_gaussians_is_left_out():
    far = torch.nn.functional.normalize(cube(200), dim=1) * 20.0
    assert torch.cat([cube(), far]).abs().max() > 10
    assert inner_box(torch.cat([cube(), far])).abs().max() < 1.0


def test_a_street_that_leads_out_of_a_dense_place_is_in_the_box():
    street = cube(600) * torch.tensor([30.0, 1.0, 1.0])
    low, high = inner_box(torch.cat([cube(), street]))
    assert low[0] < -25
    assert high[0] > 25


@pytest.mark.parametrize("places", [[[1.0, 2, 3]], [[0.0, 0, 0]] * 3 + [[1.0, 1, 1]]])
def test_gaussians_at_one_place_have_a_box(places):
    low, high = inner_box(torch.tensor(places))
    assert (low <= high).all()
    assert torch.equal(low, torch.tensor(places[0]).double())


def test_the_box_of_two_gaussians_spans_both():
    low, high = inner_box(torch.tensor([[0.0, 0, 0], [10.0, 10, 10]]))
    assert (high - low > 9).all()
