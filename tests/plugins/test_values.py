"""Tests of gsfw.plugins.values."""

import enum
import math
from pathlib import Path
from typing import Literal

import pytest

from gsfw.plugins.values import as_text, describe, parse, plain


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


VALUES = [
    (int, "7000", 7000),
    (int, "3e4", 30_000),
    (int, "-3", -3),
    (float, "1e-4", 1e-4),
    (float, 2, 2.0),
    (float, "inf", math.inf),
    (bool, "true", True),
    (bool, "YES", True),
    (bool, "0", False),
    (bool, False, False),
    (str, "a=b, c", "a=b, c"),
    (str, "-dash", "-dash"),
    (str, None, ""),
    (Path, "a/b", Path("a/b")),
    (float | None, "none", None),
    (float | None, None, None),
    (float | None, "0.5", 0.5),
    (str | None, "none", None),
    (tuple[int, ...], "1000,2000", (1000, 2000)),
    (tuple[int, ...], "[1000, 2000]", (1000, 2000)),
    (tuple[int, ...], [1000, 2000], (1000, 2000)),
    (tuple[str, ...], "", ()),
    (tuple[float, float, float], "1,1,0.5", (1.0, 1.0, 0.5)),
    (tuple[int, ...] | None, "none", None),
    (list[bool], "yes,0", [True, False]),
    (Literal["soft", "hard"], "hard", "hard"),
    (Colour, "BLUE", Colour.BLUE),
]

REFUSED = [
    (int, "abc", "a whole number"),
    (int, "1.5", "a whole number"),
    (int, True, "a whole number"),
    (int, [1], "a whole number"),
    (int, "", "a whole number"),
    (int, "1e400", "a whole number"),
    (float, "nan", "a number"),
    (bool, "maybe", "true or false"),
    (float | None, "x", "a number or none"),
    (tuple[int, ...], "1,x", "a list (a whole number, ...)"),
    (tuple[float, float, float], "1,2", "number,number,number"),
    (Literal["soft", "hard"], "middling", "one of soft, hard"),
    (Colour, "GREEN", "one of RED, BLUE"),
]


@pytest.mark.parametrize(("kind", "given", "expected"), VALUES, ids=str)
def test_text_and_plain_data_become_values(kind, given, expected):
    found = parse(kind, given)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(("kind", "given", "expected"), REFUSED, ids=str)
def test_what_is_no_such_value_is_refused_and_what_was_expected_has_a_name(kind, given, expected):
    with pytest.raises(ValueError, match=r"is not|is a list"):
        parse(kind, given)
    assert describe(kind) == expected


@pytest.mark.parametrize(("kind", "given", "value"), VALUES, ids=str)
def test_plain_data_and_text_lead_back_to_the_value(kind, given, value):
    assert parse(kind, plain(value)) == value
    assert parse(kind, as_text(value)) == value


def test_a_type_that_no_text_can_give_is_an_error_of_its_author():
    with pytest.raises(TypeError, match="cannot be read from text"):
        parse(object, "x")
