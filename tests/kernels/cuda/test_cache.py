"""Tests of gsfw.kernels.cuda.cache."""

import logging
import subprocess
import sys
from pathlib import Path

import pytest

from gsfw.kernels.cuda.cache import KernelCache, cache_folder, cache_key

CODE = bytes(range(256)) * 40
"""With line ends and zeros in it, as machine code has them."""


def test_what_was_written_is_read_again(tmp_path):
    cache = KernelCache(tmp_path / "new" / "folder")
    assert cache.read("key") is None
    cache.write("key", "_Zkernel", CODE)
    assert cache.read("key") == ("_Zkernel", CODE)
    assert cache.read("other") is None
    assert [path.name for path in cache.folder.iterdir()] == ["key.kernel"]


def test_any_other_text_or_order_gives_another_key():
    keys = [["a", "b"], ["ab"], ["", "ab"], ["b", "a"], ["a", "b", ""], ["a", "b\n"]]
    assert len({cache_key(parts) for parts in keys}) == len(keys)
    assert cache_key(iter(["a", "b"])) == cache_key(["a", "b"])


@pytest.mark.parametrize("position", [0, 70, -1])
def test_damage_anywhere_is_noticed_and_mended(tmp_path, position):
    cache = KernelCache(tmp_path)
    cache.write("key", "_Zkernel", CODE)
    path = tmp_path / "key.kernel"
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(content)
    assert cache.read("key") is None
    cache.write("key", "_Zkernel", CODE)
    assert cache.read("key") == ("_Zkernel", CODE)


def test_a_file_cut_short_counts_as_absent(tmp_path):
    cache = KernelCache(tmp_path)
    cache.write("key", "_Zkernel", CODE)
    path = tmp_path / "key.kernel"
    for length in (0, 10, 64, 65, 300):
        path.write_bytes(path.read_bytes()[:length])
        assert cache.read("key") is None


WRITER = """
import sys
from pathlib import Path
from gsfw.kernels.cuda.cache import KernelCache
cache = KernelCache(Path(sys.argv[1]))
for _ in range(50):
    cache.write("key", "_Zkernel", bytes([int(sys.argv[2])]) * 100_000)
    name, code = cache.read("key")
    assert len(set(code)) == 1
"""
"""Writes an entry over and over, which must be whole whenever it is looked at."""


def test_several_processes_may_write_the_same_entry(tmp_path):
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    writers = [subprocess.Popen([*command, str(value)]) for value in (1, 2)]
    assert [writer.wait() for writer in writers] == [0, 0]
    assert [path.name for path in tmp_path.iterdir()] == ["key.kernel"]


def test_where_nothing_can_be_written_there_is_one_warning(tmp_path, caplog):
    (tmp_path / "file").write_text("in the way")
    cache = KernelCache(tmp_path / "file" / "kernels")
    with caplog.at_level(logging.WARNING):
        cache.write("key", "_Zkernel", CODE)
        cache.write("key2", "_Zkernel", CODE)
    assert cache.read("key") is None
    (record,) = caplog.records
    assert record.getMessage() == (
        "CUDA kernels will be compiled again by the next process: "
        f"{cache.folder / 'key.kernel'} cannot be written: Not a directory. "
        "Set GSFW_CACHE_DIR to a folder that can be written to."
    )


def test_a_read_only_folder_is_read_and_not_written(tmp_path, caplog, monkeypatch):
    cache = KernelCache(tmp_path)
    cache.write("key", "_Zkernel", CODE)

    def refuse(*arguments: object, **more: object) -> None:
        raise PermissionError(13, "Permission denied")  # Root may write to read-only folders.

    monkeypatch.setattr("gsfw.core.files.atomic._partial_file", refuse)
    cache.write("key2", "_Zkernel", CODE)
    assert cache.read("key") == ("_Zkernel", CODE)
    assert cache.read("key2") is None
    assert "key2.kernel cannot be written: Permission denied." in caplog.text


def test_a_full_disk_leaves_nothing_behind(tiny_disk, caplog):
    cache = KernelCache(tiny_disk / "kernels")
    cache.write("small", "_Zkernel", CODE)
    cache.write("large", "_Zkernel", CODE * 400)
    assert cache.read("small") == ("_Zkernel", CODE)
    assert cache.read("large") is None
    assert [path.name for path in cache.folder.iterdir()] == ["small.kernel"]
    assert "the disk is full: " in caplog.text


def test_the_folder_is_chosen_by_the_user_or_by_the_system(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("GSFW_CACHE_DIR", raising=False)
    assert cache_folder() == Path("/home/someone/.cache/gsfw/kernels")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/is/ignored")
    assert cache_folder() == Path("/home/someone/.cache/gsfw/kernels")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "gsfw" / "kernels"
    monkeypatch.setenv("GSFW_CACHE_DIR", "~/mine")
    assert cache_folder() == Path("/home/someone/mine/kernels")


def test_windows_keeps_caches_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.delenv("GSFW_CACHE_DIR", raising=False)
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert cache_folder() == tmp_path / "gsfw" / "kernels"


def test_without_a_home_nothing_is_kept(monkeypatch, caplog):
    monkeypatch.delenv("GSFW_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    cache = KernelCache(cache_folder())
    cache.write("key", "_Zkernel", CODE)
    assert cache.read("key") is None
    assert len(caplog.records) == 1


def test_doctor_can_ask_whether_it_can_be_written(tmp_path, monkeypatch):
    assert KernelCache(tmp_path / "a" / "b").problem() == ""
    monkeypatch.setattr("os.access", lambda path, mode: False)
    expected = f"{tmp_path} cannot be written to; set GSFW_CACHE_DIR"
    assert KernelCache(tmp_path / "a" / "b").problem() == expected
