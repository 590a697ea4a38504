"""Objects of JSON files of other programs; those of gsfw's own are tested with their formats."""

import math
from pathlib import Path

import pytest

from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields

LONG = 10**400
"""A whole number that no float holds; JSON has such."""


def fields(**values):
    return JsonFields.of(values, Path("a.json"), "image 3")


def refusal(read):
    with pytest.raises(DataError) as caught:
        read()
    return caught.value.message


def test_numbers_are_read():
    given = fields(a=3, b=None, c=[[1, 2], [3, 4.5]])
    assert given.number("a") == given.optional_number("a") == 3.0
    assert given.number("d", 0.5) == 0.5
    assert given.optional_number("b") is given.optional_number("d") is None
    assert given.numbers("c", 2, 2).tolist() == [[1.0, 2.0], [3.0, 4.5]]
    assert given.numbers("d", 2, default=[0.0, 1.0]).tolist() == [0.0, 1.0]


def test_large_whole_numbers_are_numbers_but_no_counts():
    given = fields(time=10**18, times=[10**300, 0])
    assert given.number("time") == given.positive("time") == 1e18
    assert given.numbers("times", 2).tolist() == [1e300, 0.0]
    said = f"a.json: image 3: time: expected a whole number of at least 0, found {10**18}."
    assert refusal(lambda: given.count("time")) == said


@pytest.mark.parametrize("value", [math.inf, math.nan, LONG, True, "3", [3], None], ids=str)
def test_values_other_than_finite_numbers_are_refused(value):
    given = fields(a=value, b=[1.0, value])
    said = "a.json: image 3: a: expected one finite number, found "
    assert refusal(lambda: given.number("a")).startswith(said)
    said = "a.json: image 3: b[1]: expected one finite number, found "
    assert refusal(lambda: given.numbers("b", 2)).startswith(said)


def test_numbers_out_of_range_are_refused_and_its_ends_are_read():
    given = fields(fov=179, time=None, angle=500)
    assert given.number("fov", low=0.1, high=179.0) == 179
    assert given.optional_number("time", 0.0, 1.0) is None
    said = "a.json: image 3: angle: expected a number from 0.1 to 179, found 500."
    assert refusal(lambda: given.number("angle", low=0.1, high=179.0)) == said
    assert refusal(lambda: given.optional_number("angle", 0.1, 179.0)) == said


def test_missing_values_and_inner_objects_are_named_by_their_place():
    given = fields(a={"b": 1}, c=[{}])
    lacking = " is missing; expected one finite number."
    assert refusal(lambda: given.number("d")) == "a.json: image 3: d" + lacking
    (item,) = given.objects("c")
    assert refusal(lambda: item.number("d")) == "a.json: image 3: c[0]: d" + lacking
    said = "a.json: image 3: a: b: expected text, found 1."
    assert refusal(lambda: given.fields("a").text("b")) == said


def test_a_wrong_value_is_corrected_and_a_damaged_file_is_copied_again(tmp_path):
    with pytest.raises(DataError, match=r"\nCorrect the value, or export the file again\.$"):
        fields(a="3").number("a")
    (tmp_path / "a.json").write_text('{"a": ')
    with pytest.raises(DataError, match=r"\nIt may have been cut short or changed in copying"):
        JsonFields.read(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("text", "said"),
    [("{", "cannot be read as JSON: "), ("[1]", ": expected an object, found [1].")],
)
def test_files_of_something_else_are_refused(tmp_path, text, said):
    (tmp_path / "a.json").write_text(text)
    assert said in refusal(lambda: JsonFields.read(tmp_path / "a.json"))
