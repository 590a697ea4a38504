"""Tests of gsfw.core.loop.watchers."""

import logging
from pathlib import Path

import pytest

from gsfw.core.callback import Callback, Control
from gsfw.core.errors import OutputError
from gsfw.core.loop.watchers import Watchers


class Recorder(Callback):
    """Remembers its calls; raises at one of them."""

    def __init__(self, fails_at: str = "", error: type[BaseException] = ConnectionError) -> None:
        self.calls = []
        self.fails_at, self.error = fails_at, error

    def _note(self, name: str) -> None:
        self.calls.append(name)
        if name == self.fails_at:
            raise self.error("no network")

    def on_tick(self, step, control):
        self._note("on_tick")

    def on_checkpoint(self, step, path):
        self._note("on_checkpoint")

    def close(self):
        self._note("close")


def run(*callbacks: Callback) -> None:
    watchers = Watchers(callbacks)
    try:
        for step in (1, 2):
            watchers.on_tick(step, Control())
        watchers.on_checkpoint(2, Path("a"))
    finally:
        watchers.close()


def test_one_that_raises_is_closed_and_told_no_more_and_the_others_are(caplog):
    broken, other = Recorder("on_tick"), Recorder()
    broken.origin = "callback 'wandb' (gsfw-wandb 0.1)"
    run(broken, other)
    assert broken.calls == ["on_tick", "close"]
    assert other.calls == ["on_tick", "on_tick", "on_checkpoint", "close"]
    (record,) = caplog.records
    assert (record.name, record.levelno) == ("gsfw.run", logging.WARNING)
    assert record.getMessage() == (
        "callback 'wandb' (gsfw-wandb 0.1) failed in on_tick and is switched off; the run "
        "continues: ConnectionError: no network"
    )
    assert record.exc_info is not None


def test_one_that_fails_to_close_is_named_and_the_others_are_closed(caplog):
    callbacks = [Recorder(), Recorder("close"), Recorder()]
    run(*callbacks)
    assert [callback.calls[-1] for callback in callbacks] == ["close"] * 3
    assert [record.getMessage()[:33] for record in caplog.records] == [
        "callback Recorder failed in close"
    ]


@pytest.mark.parametrize("error", [OutputError, KeyboardInterrupt])
def test_a_full_disk_and_an_interrupt_end_the_run_and_all_are_closed(error):
    failing, other = Recorder("on_checkpoint", error), Recorder()
    with pytest.raises(error):
        run(failing, other)
    assert failing.calls[-1] == other.calls[-1] == "close"
