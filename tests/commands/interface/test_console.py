"""Tests of gsfw.commands.interface.console."""

import json

from gsfw.commands.interface.console import WIDTH_OF_FILES, Console, render_table


def test_people_get_text_on_standard_output(capsys):
    console = Console()
    console.say("hello")
    console.table(["a", "b"], [["1", "[2]"]], "both")
    console.result({"a": 1})
    console.warn("careful")
    said = capsys.readouterr()
    assert said.out == "hello\nboth\na  b\n1  [2]\n"
    assert said.err == "warning: careful\n"


def test_programs_get_one_document_there_and_nothing_else(capsys):
    console = Console(json_only=True)
    console.say("hello")
    console.table(["a"], [["1"]])
    console.result({"a": 1})
    said = capsys.readouterr()
    assert json.loads(said.out) == {"a": 1}
    assert said.err == "hello\n"


def test_only_the_last_column_of_a_table_wraps():
    lines = render_table(["", ""], [["key" * 10, "word " * 60]]).splitlines()
    assert len(lines) == 3
    assert all(len(line) <= WIDTH_OF_FILES for line in lines)
    assert lines[1].startswith(" " * 32 + "word")
