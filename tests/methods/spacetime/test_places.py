"""Where the values of ragged rows belong."""

import torch

from gsfw.methods.spacetime.places import Places

LENGTHS = torch.tensor([2, 0, 3, 1])


def test_each_value_has_a_row_and_a_place_in_it():
    places = Places.of(LENGTHS)
    assert places.rows.tolist() == [0, 0, 2, 2, 2, 3]
    assert places.within.tolist() == [0, 1, 0, 1, 2, 0]


def test_padded_values_are_zero_where_a_row_has_none_and_pack_again():
    places, values = Places.of(LENGTHS), torch.arange(1.0, 7).view(6, 1)
    padded = places.padded(values, 4, 3)
    assert padded[..., 0].tolist() == [[1, 2, 0], [0, 0, 0], [3, 4, 5], [6, 0, 0]]
    assert torch.equal(places.packed(padded), values)


def test_no_row_and_no_value_have_no_places():
    for lengths in (torch.zeros(0, dtype=torch.int64), torch.zeros(3, dtype=torch.int64)):
        places = Places.of(lengths)
        assert len(places.rows) == 0
        assert places.padded(torch.zeros(0, 3), len(lengths), 2).shape == (len(lengths), 2, 3)
