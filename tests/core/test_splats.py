"""Splats: counting, naming, cutting, joining, and dense colours from ragged ones."""

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


def in_form(form: str, degree: int = 2, count: int = 4) -> Splats:
    """Splats with SH colours in one of their three forms."""
    splats = random_splats(count, degree=degree)
    both = splats.colors.coefficients
    if form == "dense":
        return splats
    if form == "two parts":
        return replace(splats, colors=Sh(both[:, :1], degree, rest=both[:, 1:]))
    own = torch.arange(count) % (degree + 1)
    return replace(splats, colors=splats.colors.of_degrees(own))


FORMS = ["dense", "two parts", "ragged"]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_colours_up_to_a_degree_are_the_first_bands(form, degree):
    splats = in_form(form, degree=3, count=9)
    cut = splats.up_to(degree)
    assert cut.sh_degree == degree
    assert torch.equal(cut.colors.dense(), splats.colors.dense()[:, : (degree + 1) ** 2])
    assert cut.colors.width == (degree + 1) ** 2, "no other coefficients are kept"
    assert (cut.colors.offsets is not None) == (form == "ragged" and degree > 0)


def test_colours_of_no_higher_degree_and_channels_stay_as_they_are():
    splats = random_splats(5, degree=1)
    assert splats.up_to(1) is splats
    assert splats.colors.up_to(4) is splats.colors
    channels = replace(splats, colors=torch.rand(5, 3))
    assert channels.up_to(0) is channels
    assert channels.sh_degree == 0


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("other", FORMS)
def test_joined_splats_have_the_highest_degree_and_zeros_in_bands_they_lacked(form, other):
    parts = [in_form(form, 1), in_form(other, 3, count=5), in_form(form, 0, count=1)]
    both = Splats.cat(parts)
    assert (len(both), both.sh_degree) == (10, 3)
    expected = torch.zeros(10, 16, 3)
    for first, part in zip((0, 4, 9), parts, strict=True):
        dense = part.colors.dense()
        expected[first : first + len(part), : dense.shape[1]] = dense
    assert torch.equal(both.colors.dense(), expected)
    for name in ("means", "opacities", "quats", "scales"):
        assert torch.equal(getattr(both, name), torch.cat([getattr(p, name) for p in parts]))


@pytest.mark.parametrize("form", FORMS)
def test_joined_colours_of_one_form_and_degree_keep_it(form):
    one, other = in_form(form, 2).colors, in_form(form, 2, count=3).colors
    both = Sh.cat([one, other])
    assert (both.rest is None) == (one.rest is None)
    assert (both.offsets is None) == (one.offsets is None)
    assert torch.equal(both.dense(), torch.cat([one.dense(), other.dense()]))


@pytest.mark.parametrize("form", FORMS)
def test_bands_that_were_ignored_stay_so_beside_splats_of_a_higher_degree(form):
    lower = replace(in_form(form, 2).colors, degree=1)
    both = Sh.cat([lower, in_form(form, 2).colors])
    assert both.degree == 2
    assert torch.equal(both.dense()[:4, :4], lower.dense())
    assert both.dense()[:4, 4:].abs().max() == 0


def test_fields_that_only_some_of_the_joined_splats_have_are_left_out():
    one, other = random_splats(2), random_splats(3)
    named = [replace(one, rows=torch.tensor([4, 0])), replace(other, rows=torch.tensor([1, 2, 3]))]
    assert Splats.cat(named).rows.tolist() == [4, 0, 1, 2, 3]
    both = Splats.cat([named[0], replace(other, extra=torch.zeros(3, 2))])
    assert both.rows is None
    assert both.extra is None
    assert Splats.cat([one]) is one


def test_splats_of_different_kinds_cannot_be_joined():
    splats = random_splats(2)
    channels = replace(splats, colors=torch.zeros(2, 3))
    with pytest.raises(ValueError, match="SH colours, and others channels"):
        Splats.cat([splats, channels])
    assert Splats.cat([channels, channels]).colors.shape == (4, 3)
    shapes = replace(splats, quats=None, scales=None, covariances=torch.zeros(2, 3, 3))
    with pytest.raises(ValueError, match="covariances, and others quaternions"):
        Splats.cat([splats, shapes])
    assert Splats.cat([shapes, shapes]).covariances.shape == (4, 3, 3)


@pytest.mark.parametrize("form", FORMS)
def test_some_splats_have_the_colours_that_they_had_among_all(form):
    splats = replace(in_form(form), rows=torch.arange(10, 14))
    colors = splats.colors
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


def test_rows_that_float32_cannot_hold_are_told_in_any_colours():
    splats = random_splats(6, 1)
    assert isinstance(splats.colors, Sh)
    assert splats.scales is not None
    wide = splats.map(lambda tensor: tensor.double().clone())
    wide.means[0, 1] = 1e39
    wide.scales[2] = 2e38  # Finite, and above what files hold as a logarithm.
    ragged = wide.colors.of_degrees(torch.tensor([1, 1, 0, 1, 0, 1]))
    ragged.rest[3] = float("nan")  # Each row of degree 1 has three: the second row's first.
    found = replace(wide, colors=ragged).held_by_float32()
    assert found.tolist() == [False, False, False, True, True, True]
    ragged.rest[-1] = float("inf")
    found = replace(wide, colors=ragged).held_by_float32()
    assert found.tolist() == [False, False, False, True, True, False]
    assert splats.held_by_float32().all()
