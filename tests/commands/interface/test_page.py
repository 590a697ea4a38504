"""Tests of gsfw.commands.interface.page, and of every verb's help at several widths."""

import io
import os
import subprocess
import sys

import pytest
from rich.console import Console as Screen
from rich.file_proxy import FileProxy

from gsfw.commands.interface.arguments import HelpRequested
from gsfw.commands.interface.console import WIDTH_OF_FILES, screen_width
from gsfw.commands.interface.page import option_table, paragraphs
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import installed

CUT = "\N{HORIZONTAL ELLIPSIS}"
ROWS = [
    ("out=", "text", "A folder for the result."),
    ("axis=x", "one of " + ", ".join(f"direction-{index}" for index in range(9)), "The axis."),
]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch):
    """Gives standard output to a terminal of so many columns."""

    def of(columns: int) -> Terminal:
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setattr("sys.stdout", screen := Terminal())
        return screen

    return of


def help_of(run, *words: str) -> str:
    with pytest.raises(HelpRequested) as wanted:
        run([*words, "--help"])
    return str(wanted.value)


def beyond(text: str, width: int) -> list[str]:
    """Lines wider than that; an example is a command to copy, and stays whole."""
    return [
        line for line in text.splitlines() if len(line) > width and not line.startswith("  gsfw ")
    ]


@pytest.mark.parametrize("columns", [80, 100, 160])
def test_no_verbs_help_is_cut_or_wider_than_the_terminal(terminal, columns):
    terminal(columns)
    verbs = load_all("command", installed())
    assert len(verbs) > 20
    texts = {name: help_of(run) for name, run in verbs.items()}
    assert {name for name, text in texts.items() if CUT in text} == set()
    wide = {name: beyond(text, columns) for name, text in texts.items()}
    assert {name: lines for name, lines in wide.items() if lines} == {}


@pytest.mark.parametrize("columns", [80, 100])
def test_the_settings_of_a_method_fit_as_well(terminal, columns):
    terminal(columns)
    text = help_of(load_all("command", installed())["train"], "method=3dgs")
    assert CUT not in text
    assert beyond(text, columns) == []


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_on_a_real_terminal_the_width_is_its_own():
    import fcntl
    import struct
    import termios

    terminal, inside = os.openpty()
    fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("4H", 24, 80, 0, 0))
    environment = {key: text for key, text in os.environ.items() if key != "COLUMNS"}
    command = [sys.executable, "-m", "gsfw", "render", "--help"]
    process = subprocess.Popen(command, stdin=inside, stdout=inside, stderr=inside, env=environment)
    os.close(inside)
    seen = b""
    try:
        while part := os.read(terminal, 65536):
            seen += part
    except OSError:  # Linux ends a terminal so.
        pass
    os.close(terminal)
    assert process.wait() == 0
    lines = seen.decode().replace("\r\n", "\n").splitlines()
    assert "what=all" in lines
    assert "    one of all, views, orbit, path, spiral, time, orbit-time, path-time," in lines
    assert CUT not in seen.decode()
    assert 70 < max(len(line) for line in lines) <= 80


def test_the_width_is_that_of_the_terminal_while_a_bar_is_displayed(terminal, monkeypatch):
    screen = terminal(80)
    monkeypatch.setattr("sys.stdout", FileProxy(Screen(file=screen), screen))
    assert not sys.stdout.isatty()
    assert screen_width() == 80


def test_without_a_terminal_the_width_is_always_the_same(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "40")
    assert screen_width() == WIDTH_OF_FILES
    text = option_table(ROWS)
    assert text.splitlines()[0] == f"{'out=':8}{'text':26}A folder for the result."
    assert text == option_table(ROWS)


def test_on_a_narrow_terminal_the_meaning_stands_below_the_name(terminal):
    terminal(60)
    assert option_table(ROWS).splitlines() == [
        "out=  text",
        "    A folder for the result.",
        "axis=x",
        "    one of direction-0, direction-1, direction-2,",
        "    direction-3, direction-4, direction-5, direction-6,",
        "    direction-7, direction-8",
        "    The axis.",
    ]


def test_in_columns_a_long_name_has_a_line_of_its_own_and_a_long_type_wraps(terminal):
    terminal(100)
    path = "data=/" + "folder/" * 20
    lines = option_table([*ROWS, (path, "text", "A place.")]).splitlines()
    assert lines[1].split() == ["axis=x", "one", "of", "direction-0,", "The", "axis."]
    assert lines[2].split() == ["direction-1,"]
    assert lines[-2:] == [path, f"{'':38}{'text':26}A place."]


def test_tables_with_the_same_rows_beside_them_align(terminal):
    terminal(160)
    first, second = (option_table([row], alike=ROWS).splitlines()[0] for row in ROWS)
    assert first.index("A folder") == second.index("The axis")


def test_a_table_without_options_is_its_title():
    assert option_table([], "callbacks") == "callbacks"


def test_wide_paragraphs_are_filled_and_others_stay(terminal):
    terminal(60)
    text = f"short\nlines\n\n{'word ' * 11}end\nrest\n\nexamples:\n  gsfw {'x' * 70}"
    assert paragraphs(text) == (
        f"short\nlines\n\n{'word ' * 11}end\nrest\n\nexamples:\n  gsfw {'x' * 70}"
    )
    assert paragraphs(f"{'word ' * 14}end\nrest") == f"{('word ' * 12).strip()}\nword word end rest"
