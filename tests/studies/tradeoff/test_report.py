"""Tables tell losses view by view, and call what cannot be told apart a tie."""

import csv
import io

import pytest

from gsfw.studies.table import table_of_records
from gsfw.studies.tradeoff.pareto_plot import write_pareto_plot
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.report import (
    documents,
    in_order,
    is_tie,
    lost,
    metrics,
    table,
)


def record(axis, name, psnrs, **more):
    per_view = [{"psnr": psnr, "ssim": 0.9} for psnr in psnrs]
    return Record(axis, name, per_view, 1e-3, 2e-3, 1000, 59000, 236000, **more)


FIRST = record(
    *("as it is", "as it is", [30.0, 20.0, 25.0]),
    readings=[4.0, 5.0, 6.0],
    command=["export"],
    flip=0.06789,
    peak_memory_mb=12.34,
)
BOTH_WAYS = record("cutoffs", "alpha 1/64", [30.1, 19.9, 25.03], readings=[4.1, 5.1, 6.1])
ALL_LESS = record("sh", "degree 0", [29.8, 19.8, 24.8], readings=[4.1, 5.0, 6.1])
STORED = record("precision", "fp16", [30.0, 20.0, 25.0], draws_alike=True)
FAILED = Record("precision", "bf16", [], None, None, 1, 59, 236, failure="scales are infinite")
EVERY = [FIRST, BOTH_WAYS, STORED, FAILED, ALL_LESS]


def test_losses_are_compared_view_by_view():
    mean, error = lost(ALL_LESS, FIRST)
    assert abs(mean - 0.2) < 1e-9
    assert error < 1e-9
    assert not is_tie(ALL_LESS, FIRST)
    assert is_tie(BOTH_WAYS, FIRST)
    assert lost(FAILED, FIRST) is None
    assert lost(record("sh", "one", [29.0]), record("as it is", "", [30.0])) == (1.0, None)


def test_lines_are_in_the_order_of_axes_and_tell_everything():
    assert [item.name for item in in_order(EVERY)] == [
        "as it is",
        "degree 0",
        "fp16",
        "bf16",
        "alpha 1/64",
    ]
    headings, found, _ = table(EVERY)
    assert all(len(row) == len(headings) for row in found)
    assert found[0][:6] == ["as it is", "", "25.00", "", "0.9000", "0.0679"]
    assert found[0][-2] == "12.3"
    assert found[1][:4] == ["sh", "degree 0", "24.80", "0.20 ± 0.00"]
    assert found[2][3] == "tie"
    assert found[2][-3:-1] == ["as it is", "as it is"]
    assert found[3] == ["", "bf16", *[""] * 6, "1", "0.00", "", "", "", "cannot be rendered"]
    assert found[4][5] == "", "its FLIP is not known"
    assert found[4][-3:-1] == ["5.1 ± 2.0", ""]


def test_the_csv_has_the_figures_of_the_document():
    rows = list(csv.DictReader(io.StringIO(table_of_records(documents(EVERY)).csv())))
    for row, document in zip(rows, documents(EVERY), strict=True):
        assert row["name"] == document["name"]
        assert row["bytes"] == str(document["bytes"])
        assert row["flip"] == str(document["flip"] or "")
        assert row["on_front"].split() == document["on_front"]


def test_figures_that_are_not_known_are_null():
    first, *others = documents(EVERY)
    assert (first["flip"], first["peak_memory_mb"]) == (0.06789, 12.34)
    assert {other["flip"] for other in others} == {None}
    assert metrics(FIRST)["flip"] == 0.06789
    assert metrics(FIRST)["peak_memory_mb"] == 12.34


def test_documents_say_whose_time_it_is():
    by_name = {document["name"]: document for document in documents(EVERY)}
    assert by_name["fp16"]["render_ms"] == 5.0
    assert by_name["fp16"]["peak_memory_mb"] == 12.34
    assert by_name["fp16"]["render_ms_is_own"] is False
    assert by_name["degree 0"]["render_ms_is_own"] is True
    assert by_name["bf16"]["failure"] == "scales are infinite"
    assert by_name["as it is"]["command"] == "export"


@pytest.mark.slow
def test_the_plot_is_the_same_for_the_same_records(tmp_path):
    for name in ("a.png", "b.png"):
        write_pareto_plot(tmp_path / name, EVERY)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    write_pareto_plot(tmp_path / "untimed.png", [STORED, record("as it is", "as it is", [1.0])])
    assert (tmp_path / "untimed.png").stat().st_size > 1000
