"""Axes by name: what files state, the directions of the names, and the names of directions."""

import pytest
import torch

from gsfw.core.maths.axes import axis_name, axis_vector, known_axis, known_or_usual_up, stated_axis


@pytest.mark.parametrize(
    ("stated", "axis"),
    [
        *(("z", "z"), ("-y", "-y"), ("+Y", "+y"), (" -Z\n", "-z")),
        *(("", ""), ("Y-up", ""), ("up", ""), ("--z", ""), ("+-x", ""), ("xy", ""), ("-", "")),
        *((None, ""), (3, ""), (["z"], "")),
    ],
)
def test_what_names_no_axis_states_nothing(stated, axis):
    assert stated_axis(stated) == axis


@pytest.mark.parametrize(
    ("name", "vector"),
    [("x", (1, 0, 0)), ("+y", (0, 1, 0)), ("-z", (0, 0, -1)), (" -X ", (-1, 0, 0))],
)
def test_a_name_is_a_unit_vector_in_double_precision(name, vector):
    expected = torch.tensor(vector, dtype=torch.float64)
    assert torch.equal(axis_vector(name), expected)
    assert torch.equal(known_axis(name), expected)
    assert torch.equal(known_or_usual_up(name), expected)


@pytest.mark.parametrize("name", ["w", "", "sideways"])
def test_a_name_of_no_axis_is_refused_or_unknown_or_as_usual(name):
    with pytest.raises(ValueError, match=rf"^'{name}' is no axis: expected x, y, z, -x, -y or -z$"):
        axis_vector(name)
    assert known_axis(name) is None
    assert known_or_usual_up(name).tolist() == [0, -1, 0]


@pytest.mark.parametrize("name", ["x", "y", "z", "-x", "-y", "-z"])
def test_directions_near_an_axis_have_its_name_and_others_none(name):
    vector = axis_vector(name)
    assert axis_name(vector) == name
    assert axis_name(vector + 5e-4) == name
    assert axis_name(vector + 1e-2) == ""
