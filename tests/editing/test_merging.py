"""Merged splats have the moments of what they replace, and are as many as was asked."""

import pytest
import torch
from support.scenes import random_splats

from gsfw.core.maths.moments import areas
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.splats import Sh, Splats
from gsfw.editing.merging import merged_down


def covariances(splats):
    sides = rotation_matrices(splats.quats) * splats.scales[:, None, :]
    return sides @ sides.transpose(1, 2)


@pytest.mark.parametrize("count", [199, 120, 31, 1])
def test_exactly_as_many_splats_are_left_as_was_asked(count):
    splats = random_splats(200, 2, dtype=torch.float64)
    left = merged_down(splats, splats.opacities, count)
    assert len(left) == count
    assert left.colors.coefficients.shape == (count, 9, 3)
    assert all(tensor.isfinite().all() for tensor in left.tensors().values())


def test_a_pair_keeps_its_mean_covariance_mass_and_colour():
    pair = random_splats(2, 1, dtype=torch.float64)
    (one,) = [merged_down(pair, pair.opacities, 1)]
    masses = pair.opacities * areas(pair)
    shares = masses / masses.sum()
    mean = shares @ pair.means
    offsets = pair.means - mean
    inside = covariances(pair) + offsets[:, :, None] * offsets[:, None, :]
    assert torch.allclose(one.means[0], mean)
    assert torch.allclose(covariances(one)[0], torch.einsum("i,ijk->jk", shares, inside))
    assert float(one.opacities * areas(one)) == pytest.approx(float(masses.sum()))
    expected = torch.einsum("i,ikc->kc", shares, pair.colors.coefficients)
    assert torch.allclose(one.colors.coefficients[0], expected)


def test_the_useless_and_the_alike_are_merged_and_the_rest_keeps_its_bits():
    splats = random_splats(50, 1, dtype=torch.float64)
    twin = splats.take(torch.tensor([7]))
    both = Splats.cat([splats, twin])
    left = merged_down(both, torch.ones(51, dtype=torch.float64), 50)
    others = torch.tensor([row for row in range(50) if row != 7])
    assert torch.equal(left.means[:49], splats.means[others])
    assert torch.allclose(left.means[49], splats.means[7])


def test_splats_in_one_place_and_without_mass_can_be_merged():
    zeros = torch.zeros(9, 3, dtype=torch.float64)
    splats = Splats(
        means=zeros, opacities=zeros[:, 0], colors=Sh(zeros[:, None], 0),
        quats=torch.tensor([[1.0, 0, 0, 0]]).double().repeat(9, 1), scales=zeros,
    )  # fmt: skip
    left = merged_down(splats, zeros[:, 0], 2)
    assert len(left) == 2
    assert left.opacities.isfinite().all()
