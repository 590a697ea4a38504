"""Tests of gsfw.commands.interrupt."""

import signal

import pytest

from gsfw.commands.interrupt import stop_on_signal
from gsfw.core.callback import Control


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_to_stop_and_the_second_stops_at_once(number, capsys):
    control = Control()
    with stop_on_signal(control) as interrupt:
        assert not interrupt.received
        signal.raise_signal(number)
        assert interrupt.received
        assert control.stop_reason == f"interrupted by {number.name}"
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert "stopping after this step, with a checkpoint" in capsys.readouterr().err


def test_afterwards_signals_are_handled_as_before():
    before = signal.getsignal(signal.SIGTERM)
    with stop_on_signal(Control()):
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before
