"""Slow stages are shown on standard error, quick ones are not."""

import gc
import io
import sys
import threading

import pytest

from gsfw.commands.interface import progress
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.progress import SlowStages, StageBars
from gsfw.core.errors import ConfigError
from gsfw.core.progress import shown_by, stage


class Terminal(io.StringIO):
    """A standard error that is a terminal."""

    def isatty(self):
        return True


def shown(monkeypatch, stream, *, patience, until):
    """Text on standard error of a stage that ends once ``until`` is written."""
    monkeypatch.setattr(progress, "PATIENCE", patience)
    monkeypatch.setattr(progress, "LINES", 0.01)
    monkeypatch.setattr(progress, "FRAME", 0.01)
    monkeypatch.setattr(sys, "stderr", stream)
    ticks = threading.Event()
    with shown_by(SlowStages().stage), stage("reading images", 4) as advance:
        advance(1)
        while until not in stream.getvalue():
            ticks.wait(0.005)
    return stream.getvalue()


def test_a_slow_stage_says_how_far_it_is_in_plain_lines_without_a_terminal(monkeypatch):
    text = shown(monkeypatch, io.StringIO(), patience=0.0, until=" left\n")
    assert "reading images: 1 of 4, about " in text
    assert "\x1b" not in text


def test_a_slow_stage_is_a_bar_on_a_terminal_and_vanishes(monkeypatch):
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "100")
    text = shown(monkeypatch, Terminal(), patience=0.0, until="reading images")
    assert "\x1b[2K" in text  # The line is erased.


def test_a_bar_is_plain_ascii_where_the_locale_has_nothing_else(monkeypatch):
    class AsciiTerminal(Terminal):
        encoding = "ascii"

    monkeypatch.setenv("TERM", "xterm-256color")
    text = shown(monkeypatch, AsciiTerminal(), patience=0.0, until="reading images")
    assert text.isascii()


def test_a_quick_stage_is_not_shown(monkeypatch):
    assert shown(monkeypatch, io.StringIO(), patience=60.0, until="") == ""


def test_a_stage_that_does_not_advance_is_said_to_go_on(monkeypatch, capsys):
    monkeypatch.setattr(progress, "LINES", 0.01)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    with shown_by(StageBars(Console()).stage), stage("cameras", 59) as advance:
        advance(7)
        while "\n" not in sys.stdout.getvalue():
            threading.Event().wait(0.005)
    first, *_, last = sys.stdout.getvalue().splitlines()
    assert first.startswith("cameras: 7 of 59, about ")
    assert last.startswith("cameras: 7 of 59 in ")


def test_a_stage_of_unknown_length_says_for_how_long_it_has_run(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with shown_by(SlowStages().stage), stage("loading torch"):
        while "\n" not in stream.getvalue():
            threading.Event().wait(0.005)
    assert stream.getvalue() == "loading torch: 0 s so far\n"


def test_the_garbage_collector_waits_while_torch_is_loaded_and_leaves_out_its_modules(monkeypatch):
    frozen = []
    monkeypatch.delitem(sys.modules, "torch")
    monkeypatch.setattr(gc, "freeze", lambda: frozen.append(gc.isenabled()))
    with progress.loading_torch():
        assert not gc.isenabled()
    assert gc.isenabled()
    with pytest.raises(ConfigError), progress.loading_torch():
        raise ConfigError("no such method")
    assert gc.isenabled()
    assert frozen == [False]


def test_the_garbage_collector_of_a_program_that_has_loaded_torch_goes_on(monkeypatch):
    monkeypatch.setattr(gc, "freeze", lambda: pytest.fail("garbage of others is kept"))
    with progress.loading_torch():
        assert gc.isenabled()


def test_long_times_have_their_largest_unit_and_the_last_item_has_no_time_left():
    counter = progress._Counter("reading images", 4)
    counter._started -= 200
    counter.advance(1)
    assert str(counter) == "reading images: 1 of 4, about 10 min left"
    counter.advance(4)
    assert str(counter) == "reading images: 4 of 4"
    counter.total = 0
    assert str(counter) == "reading images: 3 min 20 s so far"
