"""Atomic files and folders: whole, or nothing, and errors in words."""

import pytest

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import folder_or_nothing


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
