"""Errors of the file system name the file, and leave all others as they are."""

import os

import pytest

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import read_json
from gsfw.core.files.ply_file import read_ply_header
from gsfw.core.files.reading import first_bytes, is_file, is_folder, is_there, readable
from gsfw.datamanagers.colmap.binary import read_cameras
from gsfw.datamanagers.images import read_header
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.registry import installed


def test_a_file_that_cannot_be_read_is_named_with_the_cause(tmp_path):
    path = tmp_path / "a.ply"
    message = r"a\.ply cannot be read: No such file or directory\.$"
    with pytest.raises(DataError, match=message), readable(path):
        path.read_bytes()


def test_other_errors_pass(tmp_path):
    with pytest.raises(ZeroDivisionError), readable(tmp_path):
        _ = 1 / 0


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b", "", ".", "..", "nowhere", "\udcff"])
def test_a_name_that_no_file_has_is_none(tmp_path, name):
    assert not is_file(tmp_path / name)
    assert is_folder(tmp_path / name) == is_there(tmp_path / name) == (name in ("", ".", ".."))


def test_files_folders_and_links_are_told_apart(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "itself").symlink_to("itself")
    (tmp_path / "link").symlink_to("file")
    found = {name: is_file(tmp_path / name) for name in ("file", "itself", "link", ".")}
    assert found == {"file": True, "itself": False, "link": True, ".": False}
    assert not is_there(tmp_path / "itself")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_the_first_bytes_of_what_is_no_file_are_none(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"ply\nformat")
    found = [first_bytes(tmp_path / name, 4) for name in ("file", "pipe", "absent", ".")]
    assert found == [b"ply\n", b"", b"", b""]


def splats(path):
    return find_importer(path, installed())


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("transforms.json", read_json),
        ("points.ply", read_ply_header),
        ("cameras.bin", read_cameras),
        ("a.jpg", read_header),
        *((f"a.{suffix}", splats) for suffix in ("ply", "splat", "spz", "sog", "glb")),
    ],
)
def test_a_file_that_git_lfs_has_not_downloaded_is_no_damaged_one(tmp_path, name, read):
    """The text of github.com/superdwayne/dpmsplat-AFRAME's splat.ply in a clone without LFS."""
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:6a944bf7\nsize 361\n"
    (tmp_path / name).write_text(pointer)
    with pytest.raises(DataError, match=rf"{name} is a pointer of Git LFS .*\nRun git lfs pull in"):
        read(tmp_path / name)
