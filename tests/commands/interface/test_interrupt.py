"""Tests of gsfw.commands.interface.interrupt."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
from importlib import import_module

import pytest

from gsfw.commands.interface.interrupt import (
    ENDING,
    SIGNALS,
    interrupted_once,
    leave_on_signal,
    stop_on_signal,
    unclaimed_signals,
)
from gsfw.core.callback import Control


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_signal_asks_to_stop_and_a_later_ctrl_c_stops_at_once(number, capsys):
    control = Control()
    with stop_on_signal(control) as interrupt:
        assert not interrupt.received
        signal.raise_signal(number)
        assert interrupt.received
        cause = "Ctrl-C" if number is signal.SIGINT else number.name
        assert control.stop_reason == f"interrupted by {cause}"
        for other in ENDING:  # Of other programs: they ask for the same.
            signal.raise_signal(other)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert "stopping after this step, with a checkpoint" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP")
def test_nohup_keeps_a_training_from_the_end_of_its_terminal():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signal(Control()) as interrupt:
            signal.raise_signal(signal.SIGHUP)
        assert not interrupt.received
    finally:
        signal.signal(signal.SIGHUP, before)


LEFT_ALONE = """
import os, signal, sys
from gsfw.commands.interface.interrupt import stop_on_signal
from gsfw.commands.interface.streams import lasting_streams
from gsfw.core.callback import Control
control = Control()
with lasting_streams(), stop_on_signal(control):
    os.read(0, 1)  # Until the terminal is gone.
    signal.raise_signal(signal.SIGHUP)
    print("nobody reads this", flush=True)
open(sys.argv[1], "w").write(control.stop_reason)
"""
"""A program that gets SIGHUP when its terminal is gone already."""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_a_training_whose_terminal_is_gone_stops_and_goes_on_without_lines(tmp_path):
    terminal, inside = os.openpty()
    command = [sys.executable, "-c", LEFT_ALONE, str(tmp_path / "reason")]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=inside, stderr=inside)
    os.close(inside)
    os.close(terminal)
    process.communicate(b"x")
    assert process.returncode == 0
    assert (tmp_path / "reason").read_text() == "interrupted by SIGHUP"


def test_afterwards_signals_are_handled_as_before():
    before = signal.getsignal(signal.SIGTERM)
    with stop_on_signal(Control()):
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_signal_in_the_midst_of_a_message_is_told_all_the_same(capfd, monkeypatch):
    class Interrupted(io.FileIO):
        def write(self, data):
            if control.stop_reason is None:
                signal.raise_signal(signal.SIGTERM)
            return super().write(data)

    control = Control()
    stream = io.TextIOWrapper(io.BufferedWriter(Interrupted(2, "w", closefd=False)))
    monkeypatch.setattr("sys.stderr", stream)
    with stop_on_signal(control):
        stream.write("a line\n")
        stream.flush()
    assert control.stop_reason == "interrupted by SIGTERM"
    said = capfd.readouterr().err
    assert "a line\n" in said
    assert "stopping after this step" in said


SWALLOWING = """
import os, signal
try:
    os.kill(os.getpid(), signal.{name})
    for _ in range(1000):
        pass
except BaseException:
    pass
IMPORTED = True
"""
"""A module that does with exceptions what numpy and torch do."""


@pytest.mark.parametrize(
    ("number", "end"),
    [
        *((number, leave_on_signal) for number in SIGNALS),
        (signal.SIGINT, lambda: interrupted_once("stopping")),
    ],
)
def test_a_signal_during_an_import_ends_the_program_after_it(number, end, tmp_path, monkeypatch):
    name = tmp_path.name
    (tmp_path / f"{name}.py").write_text(SWALLOWING.format(name=number.name))
    monkeypatch.syspath_prepend(tmp_path)
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)) as caught, end():
            time.sleep(5 if import_module(name) else 0)
    finally:
        signal.signal(number, before)
    assert sys.modules[name].IMPORTED
    if number != signal.SIGINT:
        assert caught.value.code == 128 + number


def test_ctrl_c_ends_an_import_that_hangs(tmp_path, monkeypatch):
    hanging = "import signal, time\nsignal.raise_signal(2)\nwhile True:\n    time.sleep(0.01)\n"
    (tmp_path / f"{tmp_path.name}.py").write_text(hanging)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("gsfw.commands.interface.interrupt.PATIENCE", 0.1)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), leave_on_signal():
            import_module(tmp_path.name)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_in_a_destructor_ends_the_program_after_it(number, capsys):
    class Thing:
        def __del__(self):
            signal.raise_signal(number)

    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)), leave_on_signal():
            time.sleep(5 if Thing() else 0)
    finally:
        signal.signal(number, before)
    assert capsys.readouterr().err == ""


def test_a_verb_that_trains_by_gsfw_train_leaves_ctrl_c_to_the_run():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with leave_on_signal():
            assert unclaimed_signals() == (signal.SIGINT,)
            with interrupted_once("stopping"):
                assert unclaimed_signals() == ()
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_leave_handlers_and_hooks_of_the_program_alone():
    def enter() -> None:
        with leave_on_signal():
            seen.append((sys.unraisablehook, *map(signal.getsignal, SIGNALS)))

    seen = [(sys.unraisablehook, *map(signal.getsignal, SIGNALS))]
    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert seen[0] == seen[1]


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no signals to single processes")
def test_ctrl_c_while_the_program_loads_prints_no_traceback(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(LOADING)
    process = subprocess.run(
        [sys.executable, "-m", "gsfw", "--version"], capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert (process.returncode, process.stderr) == (-signal.SIGINT, "")


LOADING = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # Whoever runs the tests may ignore it.
class Finder:
    def find_spec(name, path=None, target=None):
        if name == "gsfw.plugins.registry":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder)
"""
"""Sends Ctrl-C as soon as the command line is being loaded."""


@pytest.mark.parametrize("number", ENDING)
def test_elsewhere_a_signal_ends_the_program_as_its_own_end_does(number):
    # Under nohup, tests are started with signals ignored.
    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(SystemExit) as caught, leave_on_signal():
            signal.raise_signal(number)
        assert caught.value.code == 128 + number
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)


def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with leave_on_signal():
            signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)


def test_impatience_does_not_spoil_an_orderly_end(capsys):
    def interrupt_twice():
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), interrupted_once("stopping"):
        interrupt_twice()
    assert capsys.readouterr().err == "\nstopping\n"
    assert signal.getsignal(signal.SIGINT) is before


def test_training_still_stops_after_its_step():
    control = Control()
    with leave_on_signal(), stop_on_signal(control):
        signal.raise_signal(signal.SIGTERM)
    assert control.stop_reason == "interrupted by SIGTERM"


def test_only_a_signal_without_a_handler_is_taken_from_a_program_and_in_its_main_thread():
    assert unclaimed_signals() == (signal.SIGINT,)
    found: list[object] = []
    thread = threading.Thread(target=lambda: found.append(unclaimed_signals()))
    thread.start()
    thread.join()
    before = signal.signal(signal.SIGINT, lambda number, frame: None)
    try:
        found.append(unclaimed_signals())
        with stop_on_signal(Control(), unclaimed_signals()) as interrupt:
            os.kill(os.getpid(), signal.SIGINT)
        assert not interrupt.received, "the program's own handler got it"
    finally:
        signal.signal(signal.SIGINT, before)
    assert found == [(), ()]
