"""JSON has no NaN, and what is read of it has bounds."""

import json

import pytest

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import json_text, parsed_json, read_document


def test_what_is_not_a_number_is_null_at_any_depth():
    document = {"psnr": float("nan"), "views": [{"ssim": float("-inf")}, 1.5], "name": "x"}
    assert json.loads(json_text(document)) == {
        "psnr": None,
        "views": [{"ssim": None}, 1.5],
        "name": "x",
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "it is nested too deeply"),
        ("[" * 101 + "]" * 101, "it is nested more than 100 levels deep"),
        ('{"a":' * 101 + "1" + "}" * 101, "it is nested more than 100 levels deep"),
        (r'{"name": "\ud800.png"}', "surrogates not allowed"),
        ("9" * 5000, "Exceeds the limit"),
        ('{"a"', "Expecting ':'"),
        (b"\xff", "codec can't decode"),
    ],
)
def test_what_goes_beyond_the_bounds_is_a_value_error(text, words):
    with pytest.raises(ValueError, match=words):
        parsed_json(text)


def test_names_that_are_no_unicode_are_read_again():
    written = json_text({"scene": "by\udcfftes", "caf\u00e9\udcff": ["\U0001f600"]})
    assert parsed_json(written) == {
        "scene": "by\\udcfftes", "caf\u00e9\\udcff": ["\U0001f600"]
    }  # fmt: skip


def test_whatever_is_within_the_bounds_is_read():
    deep = "[" * 100 + "]" * 100
    assert json.dumps(parsed_json(deep)) == deep
    assert len(parsed_json("[" + "[1]," * 500 + "[1]]")) == 501
    assert parsed_json(r'"\ud83d\ude00"') == "\N{GRINNING FACE}"
    assert parsed_json("[[[[ in a text ]]]".join(['"', '"'])) == "[[[[ in a text ]]]"
    assert parsed_json("\ufeff{}") == parsed_json("\ufeff{}".encode()) == {}


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "[3]"])
def test_a_document_that_is_none_is_refused_in_words(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"a\.json.*\nMake it anew\."):
        read_document(path, 1, "Make it anew.")
