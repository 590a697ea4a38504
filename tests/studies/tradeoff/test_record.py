"""Records are kept as they come, and let go where the model is another one."""

import json
from dataclasses import replace

import pytest

from gsfw.core.errors import DataError
from gsfw.studies.tradeoff.record import Record, RecordStore


def record(name="degree 1"):
    return Record("sh", name, [{"psnr": 30.0}, {"psnr": 20.0}], 0.1, 0.2, 5, 50, 200)


def test_what_is_kept_is_there_again(tmp_path):
    path = tmp_path / "new" / "tradeoff.json"
    store = RecordStore(path, "a")
    store.keep(record())
    store.keep(record("degree 0"))
    store.add_round({("sh", "degree 1"): 2.0})
    store.add_round({("sh", "degree 1"): 4.0})
    again = RecordStore(path, "a")
    assert again.records == store.records
    found = again.records[("sh", "degree 1")]
    assert (found.psnr, found.ms, found.ms_spread, found.readings) == (25.0, 3.0, 2.0, [2.0, 4.0])
    assert again.records[("sh", "degree 0")].ms is None


def test_times_of_other_conditions_are_let_go(tmp_path):
    path = tmp_path / "tradeoff.json"
    store = RecordStore(path, "a", "1 thread")
    store.keep(replace(record(), flip=0.1, peak_memory_mb=3.0))
    store.add_round({("sh", "degree 1"): 2.0})
    same = RecordStore(path, "a", "1 thread").records[("sh", "degree 1")]
    assert (same.readings, same.peak_memory_mb) == ([2.0], 3.0)
    other = RecordStore(path, "a", "2 threads").records[("sh", "degree 1")]
    assert (other.readings, other.peak_memory_mb) == ([], None)
    assert (other.psnr, other.flip) == (25.0, 0.1)


def test_figures_that_an_earlier_gsfw_did_not_have_are_not_known(tmp_path):
    path = tmp_path / "tradeoff.json"
    RecordStore(path, "a").keep(replace(record(), flip=0.1, peak_memory_mb=3.0))
    document = json.loads(path.read_text())
    for item in document["records"]:
        del item["flip"], item["peak_memory_mb"]
    path.write_text(json.dumps(document))
    assert RecordStore(path, "a").records == {("sh", "degree 1"): record()}


def test_another_fingerprint_begins_anew_and_says_how_much_went(tmp_path):
    path = tmp_path / "tradeoff.json"
    RecordStore(path, "a").keep(record())
    other = RecordStore(path, "b")
    assert (other.records, other.forgotten) == ({}, 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "cannot be read as JSON: Expecting property name enclosed in double quotes"),
        ("[]", "expected schema 1, found list."),
        (json.dumps({"schema": 2}), "expected schema 1, found 2."),
        (json.dumps({"schema": 1}), "its records are not as gsfw writes them."),
        (json.dumps({"schema": 1, "records": [{"axis": "sh"}]}), "its records are not as gsfw"),
    ],
)
def test_a_damaged_file_is_told_with_what_to_do(tmp_path, text, said):
    path = tmp_path / "tradeoff.json"
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        RecordStore(path, "a")
    assert caught.value.message.startswith(str(path))
    assert said in caught.value.message
    assert caught.value.advice == "Move it away to measure anew."
