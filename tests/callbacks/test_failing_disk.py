"""A disk that fails ends no watcher with a traceback."""

import logging
import threading

import pytest

from gsfw.callbacks.event_files import told_once
from gsfw.callbacks.log import _LogFile


def fail(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_a_line_of_the_log_that_cannot_be_written_shows_no_traceback(tmp_path, capsys, monkeypatch):
    file = _LogFile(tmp_path / "log.txt")
    record = logging.LogRecord("gsfw", logging.INFO, "", 0, "a line", None, None)
    monkeypatch.setattr(file.stream, "flush", fail)
    file.emit(record)
    file.close()
    assert capsys.readouterr().err == ""


class _AsyncWriterThread(threading.Thread):
    """Fails as tensorboard's does, which has this name."""

    def run(self) -> None:
        fail()


def run_to_its_end(thread: threading.Thread) -> None:
    thread.start()
    thread.join()


def test_a_thread_that_writes_events_shows_no_traceback_and_others_do(monkeypatch):
    shown = []
    monkeypatch.setattr(threading, "excepthook", shown.append)
    with told_once():
        run_to_its_end(_AsyncWriterThread())
        assert not shown
        run_to_its_end(threading.Thread(target=fail))
        assert [error.exc_type for error in shown] == [OSError]
    run_to_its_end(_AsyncWriterThread())
    assert len(shown) == 2


def test_the_threads_of_tensorboard_have_the_name():
    writer = pytest.importorskip("tensorboard.summary.writer.event_file_writer")
    assert isinstance(writer._AsyncWriterThread, type)
