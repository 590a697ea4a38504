"""Atomic files and folders: whole, or nothing, and errors in words."""

import errno
import os
import stat
from pathlib import Path

import pytest

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import (
    atomic_file,
    folder_or_nothing,
    readable_write_errors,
    write_atomically,
)

posix = pytest.mark.skipif(os.name == "nt", reason="Windows has neither these locks nor fsync")


def fail_within(folder):
    """Write a part of a folder, and fail."""
    with folder_or_nothing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "part").write_bytes(b"1")
        raise RuntimeError


def test_a_new_folder_goes_with_all_of_its_files_after_an_error(tmp_path):
    with pytest.raises(RuntimeError):
        fail_within(tmp_path / "a" / "b")
    assert not any(tmp_path.iterdir())


def test_a_folder_that_was_there_stays(tmp_path):
    (tmp_path / "mine").write_bytes(b"1")
    with pytest.raises(RuntimeError):
        fail_within(tmp_path)
    assert (tmp_path / "mine").is_file()


def test_a_name_that_no_system_takes_is_an_error_in_words(tmp_path):
    with pytest.raises(OutputError, match="too long"):
        fail_within(tmp_path / ("a" * 300))


def test_the_partial_file_of_a_killed_process_is_replaced(tmp_path):
    (tmp_path / ".a.ply.part").write_bytes(b"half of a file, and longer than the new one")
    write_atomically(tmp_path / "a.ply", b"new")
    assert (tmp_path / "a.ply").read_bytes() == b"new"
    if os.name != "nt":
        assert os.listdir(tmp_path) == ["a.ply"]


def test_two_writers_of_one_file_do_not_disturb_each_other(tmp_path):
    path = tmp_path / "a.ply"
    with atomic_file(path) as first:
        first.write(b"fir")
        with atomic_file(path) as second:
            second.write(b"second")
        assert path.read_bytes() == b"second"
        first.write(b"st")
    assert path.read_bytes() == b"first"
    assert os.listdir(tmp_path) == ["a.ply"]


@posix
def test_a_link_in_the_place_of_the_partial_file_is_not_followed(tmp_path):
    (tmp_path / "mine").write_bytes(b"mine")
    (tmp_path / ".a.ply.part").symlink_to(tmp_path / "mine")
    write_atomically(tmp_path / "a.ply", b"new")
    assert (tmp_path / "mine").read_bytes() == b"mine"
    assert (tmp_path / "a.ply").read_bytes() == b"new"


@posix
def test_the_names_of_new_files_and_folders_are_brought_to_the_disk(tmp_path, monkeypatch):
    kept = []
    fsync = os.fsync

    def noted(handle: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            kept.append(os.readlink(f"/proc/self/fd/{handle}"))
        fsync(handle)

    if not os.path.isdir("/proc/self/fd"):
        pytest.skip("this system does not tell the names of open files")
    monkeypatch.setattr(os, "fsync", noted)
    write_atomically(tmp_path / "a" / "b" / "c", b"new")
    assert kept == [str(tmp_path), str(tmp_path / "a"), str(tmp_path / "a" / "b")]


@posix
def test_the_permissions_of_a_partial_file_of_a_killed_process_are_not_kept(tmp_path):
    left = tmp_path / ".a.ply.part"
    left.touch(0o600)
    before = os.umask(0o022)
    try:
        write_atomically(tmp_path / "a.ply", b"new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.ply").stat().st_mode) == 0o644
    assert os.listdir(tmp_path) == ["a.ply"]


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.ENOSPC, "the disk is full: a.ply could not be written."),
        (errno.EIO, "the disk of a.ply fails: Input/output error."),
        (errno.ESTALE, "the disk of a.ply fails: "),
        (errno.EROFS, "a.ply cannot be written: Read-only file system."),
    ],
)
def test_each_way_in_which_a_disk_fails_is_a_sentence_with_advice(number, said):
    def fail() -> None:
        with readable_write_errors(Path("a.ply")):
            raise OSError(number, "")

    with pytest.raises(OutputError) as caught:
        fail()
    assert caught.value.message.startswith(said)
    assert "another place with out=DIR" in caught.value.advice


@posix
def test_new_files_have_the_permissions_of_the_umask_which_no_thread_sees_changed(
    tmp_path, monkeypatch
):
    before = os.umask(0o027)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(os, "umask", lambda mask: pytest.fail("other threads see it"))
            with atomic_file(tmp_path / "a") as first, atomic_file(tmp_path / "a") as second:
                first.write(b"1")
                second.write(b"2")
            write_atomically(tmp_path / "b", b"3")
    finally:
        os.umask(before)
    assert {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()} == {0o640}
