"""JSON files."""

import math

import pytest

from gsfw.core.errors import DataError
from gsfw.datamanagers.json_file import (
    mapping,
    number,
    numbers,
    optional_number,
    read_json,
    read_object,
)

LONG = 10**400
"""A whole number that no float holds; JSON has such."""


def test_numbers_are_read():
    assert number({"a": 3}, "a", "here") == 3.0
    assert number({}, "a", "here", 0.5) == 0.5
    assert optional_number({"a": 3}, "a", "here") == 3.0
    assert optional_number({"a": None}, "a", "here") is optional_number({}, "a", "here") is None
    assert numbers([[1, 2], [3, 4.5]], 4, "here").tolist() == [1.0, 2.0, 3.0, 4.5]


@pytest.mark.parametrize("value", [math.inf, math.nan, LONG, True, "3", [3], None], ids=str)
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(DataError, match=r"here: a is .*; expected a number\."):
        number({"a": value}, "a", "here")
    with pytest.raises(DataError, match=r"here: expected 2 numbers, found "):
        numbers([1.0, value], 2, "here") if value is not True else numbers(value, 2, "here")


def test_what_is_no_object_is_refused():
    with pytest.raises(DataError, match=r"here: expected an object, found \[\]\."):
        mapping([], "here")


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    (tmp_path / "a.json").write_text("{")
    with pytest.raises(DataError, match=r"a\.json cannot be read as JSON"):
        read_json(tmp_path / "a.json")


def test_a_file_of_something_else_than_an_object_is_refused(tmp_path):
    (tmp_path / "a.json").write_text("[1]")
    with pytest.raises(DataError, match=r"a\.json: expected an object, found \[1\]\."):
        read_object(tmp_path / "a.json")
