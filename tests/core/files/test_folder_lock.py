"""Keeping a folder to one program."""

import errno
import os

import pytest

from gsfw.core.errors import OutputError
from gsfw.core.files import folder_lock
from gsfw.core.files.folder_lock import only_one


def test_a_second_study_is_kept_out_even_by_a_run_that_was_left_behind(tmp_path):
    with (
        only_one(tmp_path, "another study") as lock,
        pytest.raises(OutputError, match="another study is at work there"),
        only_one(tmp_path, "another study"),
    ):
        pass
    with only_one(tmp_path, "another study") as lock:
        assert lock is not None
        inherited = os.dup(lock)  # As by a process.
    with pytest.raises(OutputError), only_one(tmp_path, "another study"):
        pass
    os.close(inherited)
    with only_one(tmp_path, "another study"):
        pass


def test_a_disk_that_has_no_locks_is_told(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(folder_lock.fcntl, "flock", refuse)
    with pytest.raises(OutputError) as caught, only_one(tmp_path, "another study"):
        pass
    assert str(caught.value) == (
        f"{tmp_path} cannot be locked against another study: No locks available.\n"
        "Choose a folder on another disk with out=DIR."
    )


def test_a_folder_that_cannot_be_is_told(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(OutputError, match="file cannot be written: File exists"),
        only_one(tmp_path / "file", "another study"),
    ):
        pass
