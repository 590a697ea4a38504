"""Splats: counting, naming, and dense colours from ragged ones."""

import torch
from scenes import random_splats

from gsfw.core.splats import Sh, Splats


def ragged() -> Sh:
    """Three splats with 4, 1 and 9 coefficients, numbered through."""
    offsets = torch.tensor([0, 4, 5, 14])
    return Sh(torch.arange(42.0).view(14, 3), 2, offsets)


def test_dense_coefficients_are_cut_at_the_active_degree():
    coefficients = torch.rand(5, 16, 3)
    assert torch.equal(Sh(coefficients, 3).dense(), coefficients)
    assert torch.equal(Sh(coefficients, 1).dense(), coefficients[:, :4])
    assert torch.equal(Sh(coefficients, 0).dense(), coefficients[:, :1])


def test_ragged_coefficients_are_padded_with_zeros():
    dense = ragged().dense()
    values = ragged().coefficients
    assert dense.shape == (3, 9, 3)
    assert torch.equal(dense[0, :4], values[:4])
    assert torch.equal(dense[1, :1], values[4:5])
    assert torch.equal(dense[2], values[5:])
    assert dense[0, 4:].abs().max() == 0
    assert dense[1, 1:].abs().max() == 0


def test_ragged_coefficients_are_cut_at_the_active_degree():
    colors = ragged()
    dense = Sh(colors.coefficients, 1, colors.offsets).dense()
    assert torch.equal(dense, colors.dense()[:, :4])


def test_ragged_coefficients_get_the_gradient_of_their_place():
    values = ragged().coefficients.requires_grad_()
    dense = Sh(values, 1, ragged().offsets).dense()
    weights = torch.rand(dense.shape)
    (dense * weights).sum().backward()
    assert values.grad is not None
    assert torch.equal(values.grad[:4], weights[0])
    assert torch.equal(values.grad[4], weights[1, 0])
    assert torch.equal(values.grad[5:9], weights[2])
    assert values.grad[9:].abs().max() == 0, "above the active degree"


def test_no_splats_have_no_coefficients():
    empty = Sh(torch.zeros(0, 3), 2, torch.zeros(1, dtype=torch.long))
    assert empty.dense().shape == (0, 9, 3)


def test_length_and_channels_come_from_the_tensors():
    splats = random_splats(7)
    assert len(splats) == 7
    assert splats.channels == 3
    assert Splats(splats.means, splats.opacities, torch.zeros(7, 5)).channels == 5


def test_tensors_are_those_that_are_present():
    splats = random_splats(7)
    assert list(splats.tensors()) == ["means", "opacities", "colors", "quats", "scales"]
    assert isinstance(splats.colors, Sh)
    assert splats.tensors()["colors"] is splats.colors.coefficients
    other = Splats(
        splats.means,
        splats.opacities,
        torch.zeros(7, 5),
        covariances=torch.zeros(7, 3, 3),
        extra=torch.zeros(7, 2),
        rows=torch.arange(7),
    )
    assert list(other.tensors()) == ["means", "opacities", "colors", "covariances", "extra"]
