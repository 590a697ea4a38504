"""Long work in native code that Ctrl-C ends."""

import _thread
import subprocess
import sys
import time
from threading import Thread

import pytest

from gsfw.preparation import cancellation
from gsfw.preparation.cancellation import cancellable


def test_results_and_errors_come_out_of_the_thread():
    assert cancellable(lambda token: 7) == 7
    with pytest.raises(ZeroDivisionError):
        cancellable(lambda token: 1 // 0)


def test_ctrl_c_cancels_and_waits_for_the_end_whatever_signals_follow():
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


def test_a_process_ends_when_its_parent_was_ended_by_force(tmp_path):
    """Such a parent cannot say so: without a look at it, its processes would wait for ever."""
    parent = tmp_path / "parent.py"
    parent.write_text(
        "import multiprocessing, os, time\n"
        "from gsfw.preparation.cancellation import end_with_parent\n"
        "def wait():\n"
        "    end_with_parent()\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)\n"
        "if __name__ == '__main__':\n"
        "    multiprocessing.get_context('spawn').Process(target=wait).start()\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, str(parent)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        process.kill()
        # Its output ends when the last process that holds it has ended.
        assert process.communicate(timeout=30)[0] == b""
