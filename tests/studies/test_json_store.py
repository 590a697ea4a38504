"""Tests of gsfw.studies.result."""

import pytest

from gsfw.core.errors import DataError
from gsfw.studies.result import Failure, Result, ResultStore


def test_results_and_failures_are_read_again(tmp_path):
    path = tmp_path / "results.json"
    store = ResultStore(path, "A study")
    result = Result("a", "b", 1, "f", {"steps": 3}, {"steps": 3}, {"psnr": 20.5}, {}, {}, "today")
    store.keep(result)
    failure = Failure("a", "b", 2, "no.", "Do not.", True)
    store.keep(failure)
    again = ResultStore(path, "A study")
    assert again.results == {("b", "a", 1): result}
    assert again.failures == {("b", "a", 2): failure}
    again.forget(("b", "a", 2))
    assert ResultStore(path, "A study").failures == {}


def test_a_result_takes_the_place_of_a_failure_and_the_other_way_round(tmp_path):
    store = ResultStore(tmp_path / "results.json", "A study")
    store.keep(Failure("a", "b", 1, "no."))
    store.keep(Result("a", "b", 1, "f", {}, {}, {}))
    assert (len(store.results), len(store.failures)) == (1, 0)
    store.keep(Failure("a", "b", 1, "no."))
    assert (len(store.results), len(store.failures)) == (0, 1)


def test_a_file_with_more_than_this_version_knows_is_read(tmp_path):
    path = tmp_path / "results.json"
    path.write_text(
        '{"schema": 1, "failures": [{"row": "a", "scene": "b", "seed": 1, "error": "", "new": 1}]}'
    )
    assert list(ResultStore(path, "").failures) == [("b", "a", 1)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", "cannot be read as JSON: Expecting property name"),
        ("[]", "expected schema 1, found list"),
        ('{"schema": 2}', "expected schema 1, found 2"),
        ('{"schema": 1, "results": [{"row": "a"}]}', "results are not as gsfw writes them"),
        ('{"schema": 1, "results": [3]}', "results are not as gsfw writes them"),
    ],
)
def test_a_damaged_file_is_not_overwritten(tmp_path, text, expected):
    path = tmp_path / "results.json"
    path.write_text(text)
    with pytest.raises(DataError, match=expected):
        ResultStore(path, "")


RESULT = (
    '{"schema": 1, "results": [{"row": "a", "scene": "b", "seed": 1, "fingerprint": "f", '
    '"given": {}, "settings": {}, "figures": {"psnr": 20.5}}]}'
)


@pytest.mark.parametrize(
    ("text", "by", "expected"),
    [
        ("20.5", '"abc"', "results[0]: figures.psnr is 'abc'; expected a number."),
        ("20.5", "true", "results[0]: figures.psnr is True; expected a number."),
        ("20.5", "Infinity", "results[0]: figures.psnr is inf; expected a number."),
        ('"seed": 1', '"seed": "1"', "results[0]: seed is '1'; expected a whole number."),
        ('"a"', "3", "results[0]: row is 3; expected text."),
        ('"given": {}', '"given": []', "results[0]: given is []; expected an object."),
    ],
)
def test_a_value_of_the_wrong_type_is_named(tmp_path, text, by, expected):
    path = tmp_path / "results.json"
    path.write_text(RESULT)
    assert len(ResultStore(path, "").results) == 1
    path.write_text(RESULT.replace(text, by))
    with pytest.raises(DataError) as caught:
        ResultStore(path, "")
    assert str(caught.value) == (
        f"{path}: {expected}\nPut it right, or move the file away to begin anew: finished runs are "
        "found again in their folders."
    )


def test_a_failure_is_looked_at_too(tmp_path):
    path = tmp_path / "results.json"
    failure = '{"row": "a", "scene": "b", "seed": 1, "error": "no.", "resumable": 1}'
    path.write_text(f'{{"schema": 1, "failures": [{failure}]}}')
    with pytest.raises(DataError, match=r"failures\[0\]: resumable is 1; expected true or false"):
        ResultStore(path, "")
