"""Records of campaigns are read back, and the page of promises follows from them."""

import importlib
import re
from pathlib import Path

import pytest
from campaign import Detail, Promise, Record
from promises import PAGE, Defect, Kept, defects, kept_by_tests, page

ROOT = Path(__file__).parents[2]


@pytest.fixture
def record():
    return Record(
        "broken-files",
        "2026-11-27",
        "python campaigns broken-files --size 12000 --seed 0",
        "Some processor, 2 threads",
        "0123456789ab",
        130.0,
        [
            Promise("A file ends in words.", "12,000 files.", "0 crashes", True),
            Promise("A file takes no time.", "An alarm.", "1 hang", False),
        ],
        [Detail("By reader:", ("reader", "files"), [("ply | points", 12000)])],
        ["ply, seed 7: it goes on for more than 10 s"],
    )


def test_a_record_is_read_back(tmp_path, record):
    found = Record.read(record.write(tmp_path))
    assert found.promises == record.promises
    assert found.failures == record.failures
    assert [list(row) for row in found.details[0].rows] == [["ply | points", 12000]]


def test_the_page_shows_promises_figures_failures_and_defects(record):
    mended = Defect("broken-files", "A count of a PLY was trusted.", "tests/a.py::test_b")
    text = page([record], [mended, Defect("other", "Not here.", "tests/c.py::test_d")])
    assert "| A file ends in words. | 12,000 files. | 0 crashes | yes | 2026-11-27 |" in text
    assert "| 1 hang | **no** |" in text
    assert "1 of 2 promises held when they were last tried" in text
    assert "found 2 defects" in text
    assert "| ply \\| points | 12,000 |" in text
    assert "* ply, seed 7: it goes on for more than 10 s" in text
    assert "* A count of a PLY was trusted. (`tests/a.py::test_b`)" in text
    assert "Not here." not in text


def test_the_page_names_the_tests_of_other_promises(record):
    text = page([record], [], [Kept("Two runs never mix.", ["tests/a.py::test_b"])])
    assert "| Two runs never mix. | `tests/a.py::test_b` |" in text


def test_every_defect_and_every_promise_names_tests_that_exist():
    kept = kept_by_tests()
    assert kept
    for test in [each.test for each in defects()] + [test for each in kept for test in each.tests]:
        path, _, name = test.partition("::")
        assert re.search(rf"def {re.escape(name)}\(", (ROOT / path).read_text()), test


def test_the_page_is_that_of_the_records():
    folder = Path(importlib.import_module("campaign").RESULTS)
    records = [Record.read(path) for path in sorted(folder.glob("*.json"))]
    if not records:
        pytest.skip("no campaign has a record")
    assert PAGE.read_text() == page(records, defects(), kept_by_tests())
