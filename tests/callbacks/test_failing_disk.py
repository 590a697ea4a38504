"""A disk that fails ends no watcher with a traceback."""

import logging
import re
import threading

import pytest
from support.watched_run import SUMMARY, evaluation, report_of, run_info, view

from gsfw.callbacks.board_curves import evaluation_curves, result_curves, step_curves
from gsfw.callbacks.event_files import told_once
from gsfw.callbacks.log import _LogFile
from gsfw.callbacks.tensorboard import TensorBoard, _stays
from gsfw.core.callback import Control
from gsfw.core.errors import OutputError


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


def test_events_that_cannot_be_written_end_in_a_sentence_at_every_event_of_a_run(
    tmp_path, monkeypatch
):
    board, control = TensorBoard(2), Control()
    board.on_start(run_info(tmp_path, steps=100), control)
    with monkeypatch.context() as failing:
        writer = board._writer._get_file_writer()
        failing.setattr(writer, "add_event", fail)
        failing.setattr(writer, "flush", fail)
        for event in (
            lambda: board.on_step(report_of(10), control),
            lambda: board.on_view(100, view(0)),
            lambda: board.on_evaluation(100, evaluation(), control),
            lambda: board.on_end(100, SUMMARY),
        ):
            with pytest.raises(OutputError, match=re.escape(str(tmp_path))):
                event()
    board.close()


def test_an_event_of_several_curves_is_kept_or_left_out_as_a_whole(tmp_path):
    run = run_info(tmp_path, steps=100, first_step=50)
    for curves in (
        step_curves(report_of(50), 1.0),
        evaluation_curves(evaluation(training_psnr=3.0)),
        result_curves(SUMMARY),
    ):
        assert len(curves) > 1
        for step in (40, 50, 60, 100):
            assert len({_stays(run, step, tag) for tag in curves}) == 1
