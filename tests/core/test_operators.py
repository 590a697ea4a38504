"""Torch defaults of the operators: the loss and the nearest neighbours (Adam: test_optimizer)."""

import numpy as np
import pytest
import torch

from gsfw.core.maths.ssim import ssim
from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators


def pictures(*shape, seed=0, dtype=torch.float64):
    generator = torch.Generator().manual_seed(seed)
    return [torch.rand(*shape, generator=generator, dtype=dtype) for _ in range(2)]


def test_the_loss_is_the_mean_difference_and_what_ssim_lacks():
    rendered, target = pictures(2, 14, 17, 3)
    l1, dssim = Operators().l1_dssim(rendered, target)
    assert float(l1) == pytest.approx(np.abs(rendered.numpy() - target.numpy()).mean(), rel=1e-12)
    assert float(dssim) == pytest.approx(1 - float(ssim(rendered, target)), rel=1e-12)


def test_l1_is_the_mean_over_valid_pixels():
    rendered, target = pictures(2, 14, 17, 3)
    valid = torch.rand(2, 14, 17, 1, generator=torch.Generator().manual_seed(1)) < 0.4
    l1, _ = Operators().l1_dssim(rendered, target, valid)
    inside = valid[..., 0].numpy()
    expected = np.abs(rendered.numpy()[inside] - target.numpy()[inside]).mean()
    assert float(l1) == pytest.approx(expected, rel=1e-12)


def test_a_mask_that_is_empty_gives_a_finite_loss_without_gradient():
    rendered, target = pictures(1, 12, 12, 3)
    rendered.requires_grad_()
    l1, dssim = Operators().l1_dssim(rendered, target, torch.zeros(1, 12, 12, 1, dtype=torch.bool))
    (l1 + dssim).backward()
    assert float(l1.detach()) == 0.0
    assert rendered.grad is not None
    assert not rendered.grad.any()


def test_pixels_outside_the_mask_have_no_gradient():
    rendered, target = pictures(1, 16, 16, 3)
    rendered.requires_grad_()
    valid = torch.ones(1, 16, 16, 1, dtype=torch.bool)
    valid[:, 4:9, 5:11] = False
    sum(Operators().l1_dssim(rendered, target, valid)).backward()
    assert rendered.grad is not None
    assert not rendered.grad[~valid.expand_as(rendered)].any()
    assert bool((rendered.grad[valid.expand_as(rendered)] != 0).all())


def test_neighbor_distances_are_sorted_and_leave_the_point_itself_out():
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [0, 5, 0]])
    distances = Operators().neighbor_distances(points, 2)
    assert distances.tolist()[:3] == [[1, 3], [1, 2], [2, 3]]
    assert distances.dtype == torch.float32


def test_missing_neighbors_are_infinitely_far():
    distances = Operators().neighbor_distances(torch.zeros(1, 3), 3)
    assert distances.tolist() == [[float("inf")] * 3]


def test_neighbors_are_the_nearest_rows_in_any_dimension():
    generator = torch.Generator().manual_seed(0)
    points = torch.randn(60, 4, generator=generator)
    distances = torch.cdist(points, points).fill_diagonal_(torch.inf)
    assert torch.equal(Operators().neighbors(points, 5), distances.argsort(dim=1)[:, :5])


def test_neighbors_of_points_that_coincide_are_others_and_missing_ones_the_point_itself():
    rows = Operators().neighbors(torch.zeros(6, 4), 3)
    assert not bool((rows == torch.arange(6)[:, None]).any())
    assert Operators().neighbors(torch.zeros(1, 3), 3).tolist() == [[0, 0, 0]]
    assert Operators().neighbors(torch.tensor([[0.0], [1.0]]), 2).tolist() == [[1, 0], [0, 1]]


def test_one_step_of_adam_by_hand():
    values = torch.tensor([1.0, -2.0], dtype=torch.float64)
    moments = AdamMoments.zeros_like(values)
    gradient = torch.tensor([0.5, -3.0], dtype=torch.float64)
    Operators().adam_(
        [AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), torch.tensor(True)
    )
    # After the first step both corrected moments are exact, so that every value moves by the rate.
    assert values.tolist() == pytest.approx([1 - 0.01, -2 + 0.01], rel=1e-14)
    assert moments.first.tolist() == pytest.approx([0.05, -0.3], rel=1e-12)
    assert moments.second.tolist() == pytest.approx([2.5e-4, 9e-3], rel=1e-12)
    assert float(moments.count) == 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_one_bad_number_in_any_tensor_is_found(bad):
    tensors = [torch.tensor(1.0), torch.randn(4, 3), torch.zeros(0)]
    assert Operators().all_finite(tensors)
    assert not Operators().all_finite([*tensors, torch.tensor([0.0, bad])])
