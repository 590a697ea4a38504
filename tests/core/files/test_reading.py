"""Errors of the file system name the file, and leave all others as they are."""

import pytest

from gsfw.core.errors import DataError
from gsfw.core.files.reading import readable


def test_a_file_that_cannot_be_read_is_named_with_the_cause(tmp_path):
    path = tmp_path / "a.ply"
    message = r"a\.ply cannot be read: No such file or directory\.$"
    with pytest.raises(DataError, match=message), readable(path):
        path.read_bytes()


def test_other_errors_pass(tmp_path):
    with pytest.raises(ZeroDivisionError), readable(tmp_path):
        _ = 1 / 0
