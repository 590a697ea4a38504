"""A table is the same text for a terminal, in Markdown and as CSV."""

import csv
import io

from gsfw.studies.table import Table, table_of_records


def test_a_markdown_table_is_aligned_and_keeps_bars_within_cells():
    table = Table(["", "PSNR"], [["one | two", "20.0"]])
    assert table.markdown() == "|  | PSNR |\n| --- | ---: |\n| one \\| two | 20.0 |"


def test_records_become_columns_with_all_their_keys():
    records = [{"name": "a, b", "psnr": 1 / 3, "axes": ["x", "y"]}, {"name": "c", "set": {"k": 1}}]
    table = table_of_records(records)
    assert table.headings == ["name", "psnr", "axes", "set"]
    rows = list(csv.DictReader(io.StringIO(table.csv())))
    assert rows[0] == {"name": "a, b", "psnr": str(1 / 3), "axes": "x y", "set": ""}
    assert rows[1] == {"name": "c", "psnr": "", "axes": "", "set": "k=1"}


def test_what_is_not_known_is_an_empty_cell():
    assert table_of_records([{"psnr": None, "tie": True}]).rows == [["", "True"]]
