"""Files of a run are written whole or not at all."""

import errno
import json
import os
import shutil
from pathlib import Path

import pytest
import torch

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder


def test_only_the_last_two_checkpoints_stay(tmp_path):
    folder = RunFolder(tmp_path)
    for step in (0, 5, 10, 100000):
        folder.write_checkpoint(step, {})
    names = sorted(path.name for path in folder.checkpoints.iterdir())
    assert names == ["step_000000010.pt", "step_000100000.pt"]
    assert folder.latest_checkpoint() == folder.checkpoint(100000)


def test_resuming_from_an_earlier_step_drops_what_had_followed_it(tmp_path):
    folder = RunFolder(tmp_path)
    for step in (10, 20, 15):
        folder.write_checkpoint(step, {})
    assert folder.latest_checkpoint() == folder.checkpoint(15)
    assert not folder.checkpoint(20).exists()
    assert folder.checkpoint(10).exists()


def test_an_interrupted_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "metrics.json"
    write_atomically(path, b"old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OutputError, match="the disk is full"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_to_is_one_clear_message(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written") as caught:
        write_atomically(tmp_path / "file" / "metrics.json", b"x")
    assert "out=DIR" in str(caught.value)


def test_a_full_disk_keeps_the_last_good_checkpoint(tiny_disk):
    folder = RunFolder(Path(tiny_disk) / "run")
    folder.write_checkpoint(1, {"values": torch.ones(100_000)})
    with pytest.raises(OutputError, match="the disk is full"):
        folder.write_checkpoint(2, {"values": torch.ones(200_000)})
    assert [path.name for path in folder.checkpoints.iterdir()] == ["step_000000001.pt"]
    assert read_checkpoint(folder.checkpoint(1))["values"].sum() == 100_000


def test_the_log_is_cut_back_to_the_checkpoint_and_a_torn_line_is_dropped(tmp_path):
    folder = RunFolder(tmp_path)
    lines = [json.dumps({"step": step}) for step in (10, 20, 30)]
    folder.metrics_log.write_text("\n".join(lines) + '\n{"step": 4')
    folder.cut_metrics_log(20, False)
    assert folder.metrics_log.read_text() == '{"step": 10}\n{"step": 20}\n'


@pytest.mark.parametrize("line", [b"[1]", b"{}", b'{"step": "x"}', b"[" * 100_000, b"\xff"])
def test_the_log_ends_before_a_line_that_is_none(tmp_path, line):
    folder = RunFolder(tmp_path)
    folder.metrics_log.write_bytes(b'{"step": 10}\n' + line + b'\n{"step": 20}\n')
    folder.cut_metrics_log(20, False)
    assert folder.metrics_log.read_text() == '{"step": 10}\n'


def test_an_evaluation_that_is_repeated_is_dropped_from_the_log(tmp_path):
    folder = RunFolder(tmp_path)
    evaluated = [{"step": 10, "eval/psnr": 1.0}, {"step": 20, "loss": 0.5}]
    last = {"step": 20, "eval/psnr": 2.0}
    text = "".join(json.dumps(line) + "\n" for line in (*evaluated, last))
    folder.metrics_log.write_text(text)
    folder.cut_metrics_log(20, False)
    assert folder.metrics_log.read_text() == text
    folder.cut_metrics_log(20, True)
    left = folder.metrics_log.read_text().splitlines()
    assert [json.loads(line) for line in left] == evaluated


def test_a_run_is_finished_when_all_of_its_files_are_written(tmp_path):
    folder = RunFolder(tmp_path)

    def interrupted() -> None:
        with folder.written_to():
            folder.write_json(folder.summary, {"completed": True})
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert folder.summary.is_file()
    assert not folder.is_finished
    with folder.written_to(lambda: False):  # A signal has left out the report.
        pass
    assert not folder.is_finished
    with folder.written_to():
        pass
    assert folder.is_finished


def test_a_checkpoint_of_a_killed_process_that_is_not_whole_is_removed(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_checkpoint(1, {})
    (folder.checkpoints / ".step_000000002.pt.part").write_bytes(b"half")
    folder.write_checkpoint(3, {})
    names = sorted(path.name for path in folder.checkpoints.iterdir())
    assert names == ["step_000000001.pt", "step_000000003.pt"]


def test_a_run_whose_disk_is_gone_writes_nothing_in_its_place(tmp_path):
    folder = RunFolder(tmp_path / "run")

    def train() -> None:
        with folder.written_to():
            shutil.rmtree(folder.path)  # Its disk is unmounted.
            with pytest.raises(OutputError, match="run is gone: it was removed, or its disk"):
                folder.write_checkpoint(1, {})
            assert not folder.path.exists()

    with pytest.raises(OutputError, match="continue with gsfw resume"):
        train()


def test_a_folder_in_place_of_the_log_is_left_alone(tmp_path):
    folder = RunFolder(tmp_path)
    folder.metrics_log.mkdir()
    folder.cut_metrics_log(20, False)
    assert folder.metrics_log.is_dir()


def test_checkpoints_that_may_not_be_read_do_not_count_as_none(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    assert RunFolder(tmp_path).latest_checkpoint() is None
    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(PermissionError):
        RunFolder(tmp_path).latest_checkpoint()
