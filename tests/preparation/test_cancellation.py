"""Long work in native code that Ctrl-C ends."""

import _thread
import time
from threading import Thread

import pytest

from gsfw.preparation import cancellation
from gsfw.preparation.cancellation import cancellable


def test_results_and_errors_come_out_of_the_thread():
    assert cancellable(lambda token: 7) == 7
    with pytest.raises(ZeroDivisionError):
        cancellable(lambda token: 1 // 0)


def test_ctrl_c_cancels_and_waits_for_the_end():
    ended = []

    def work(token):
        _thread.interrupt_main()
        while not token.is_cancelled:
            time.sleep(0.01)
        time.sleep(0.1)
        ended.append(True)

    with pytest.raises(KeyboardInterrupt):
        cancellable(work)
    assert ended == [True]


def test_further_signals_do_not_end_the_wait():
    ended = []

    def work(token):
        _thread.interrupt_main()
        while not token.is_cancelled:
            time.sleep(0.01)
        time.sleep(0.05)
        _thread.interrupt_main()
        time.sleep(0.2)
        ended.append(True)

    with pytest.raises(KeyboardInterrupt):
        cancellable(work)
    assert ended == [True]


def test_ctrl_c_while_the_thread_starts_lets_no_work_begin(monkeypatch):
    class Interrupted(Thread):
        def start(self):
            super().start()
            time.sleep(0.05)
            raise KeyboardInterrupt

    begun = []
    monkeypatch.setattr(cancellation, "Thread", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        cancellable(begun.append)
    assert begun == []
