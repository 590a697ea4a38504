"""Splats: counting, naming, and dense colours from ragged ones."""

from dataclasses import replace

import pytest
import torch
from support.scenes import random_splats

from gsfw.core.splats import Sh, Splats


def ragged() -> Sh:
    """Three splats of degrees 1, 0 and 2, whose coefficients are numbered through."""
    offsets = torch.tensor([0, 3, 3, 11])
    return Sh(torch.arange(9.0).view(3, 1, 3), 2, torch.arange(9.0, 42.0).view(11, 3), offsets)


def test_dense_coefficients_are_cut_at_the_active_degree():
    coefficients = torch.rand(5, 16, 3)
    assert torch.equal(Sh(coefficients, 3).dense(), coefficients)
    assert torch.equal(Sh(coefficients, 1).dense(), coefficients[:, :4])
    assert torch.equal(Sh(coefficients, 0).dense(), coefficients[:, :1])


def test_ragged_coefficients_are_padded_with_zeros():
    dense, rest = ragged().dense(), ragged().rest
    assert dense.shape == (3, 9, 3)
    assert torch.equal(dense[:, :1], ragged().coefficients)
    assert torch.equal(dense[0, 1:4], rest[:3])
    assert torch.equal(dense[2, 1:], rest[3:])
    assert dense[0, 4:].abs().max() == 0
    assert dense[1, 1:].abs().max() == 0


def test_ragged_coefficients_are_cut_at_the_active_degree():
    dense = replace(ragged(), degree=1).dense()
    assert torch.equal(dense, ragged().dense()[:, :4])


def test_ragged_coefficients_get_the_gradient_of_their_place():
    rest = ragged().rest.requires_grad_()
    dense = replace(ragged(), degree=1, rest=rest).dense()
    weights = torch.rand(dense.shape)
    (dense * weights).sum().backward()
    assert torch.equal(rest.grad[:3], weights[0, 1:])
    assert torch.equal(rest.grad[3:6], weights[2, 1:])
    assert rest.grad[6:].abs().max() == 0, "above the active degree"


def test_dense_colours_of_given_degrees_lose_what_is_above_them():
    dense = random_splats(4, degree=2).colors
    cut = dense.of_degrees(torch.tensor([1, 0, 2, 1]))
    assert cut.offsets.tolist() == [0, 3, 3, 11, 14]
    assert cut.width == 9
    assert torch.equal(cut.dense()[2], dense.dense()[2])
    assert torch.equal(cut.dense()[3, :4], dense.dense()[3, :4])
    assert cut.dense()[3, 4:].abs().max() == 0


@pytest.mark.parametrize("form", ["dense", "two parts", "ragged"])
def test_some_splats_have_the_colours_that_they_had_among_all(form):
    splats = random_splats(4, degree=2)
    both = splats.colors.coefficients
    colors = {
        "dense": splats.colors,
        "two parts": Sh(both[:, :1], 2, rest=both[:, 1:]),
        "ragged": splats.colors.of_degrees(torch.tensor([1, 0, 2, 1])),
    }[form]
    splats = replace(splats, colors=colors, rows=torch.arange(10, 14))
    rows = torch.tensor([3, 1, 2])
    some = splats.take(rows)
    assert torch.equal(some.means, splats.means[rows])
    assert torch.equal(some.rows, torch.tensor([13, 11, 12]))
    assert torch.equal(some.colors.dense(), colors.dense()[rows])


def test_everything_that_is_there_goes_to_a_device():
    splats = replace(random_splats(3, degree=2), colors=ragged(), rows=torch.arange(3))
    moved = splats.to("meta")
    assert {tensor.device.type for tensor in moved.tensors().values()} == {"meta"}
    assert moved.colors.offsets.is_meta
    assert moved.rows.is_meta


def test_no_splats_have_no_coefficients():
    offsets = torch.zeros(1, dtype=torch.long)
    empty = Sh(torch.zeros(0, 1, 3), 2, torch.zeros(0, 3), offsets)
    assert empty.dense().shape == (0, 9, 3)
    assert empty.width == 1


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
