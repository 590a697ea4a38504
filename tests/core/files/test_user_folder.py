"""Folders of a user without a home, among temporary files that everybody may write."""

import os
import stat

import pytest

from gsfw.core.errors import OutputError
from gsfw.core.files.user_folder import temporary_root

pytestmark = pytest.mark.skipif(os.name == "nt", reason="owners and modes are those of POSIX")


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    """The folder of temporary files."""
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    return tmp_path / f"gsfw-{os.getuid()}"


def test_it_is_of_this_user_alone_and_stays(place):
    assert temporary_root() == place
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert temporary_root() == place


def test_a_link_that_somebody_else_has_put_there_is_refused(place, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    place.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="is not a folder that this user alone may write"):
        temporary_root()


def test_a_folder_that_others_may_write_is_refused(place):
    place.mkdir()
    place.chmod(0o777)
    with pytest.raises(OutputError, match="XDG_CACHE_HOME"):
        temporary_root()


def test_a_folder_of_another_user_is_refused(place, monkeypatch):
    place.mkdir(mode=0o700)
    own = os.getuid()
    monkeypatch.setattr("os.getuid", lambda: own + 1)
    place.rename(place.with_name(f"gsfw-{own + 1}"))
    with pytest.raises(OutputError, match="this user alone"):
        temporary_root()


def test_a_file_in_its_place_is_refused(place):
    place.write_text("")
    with pytest.raises(OutputError, match="cannot be made"):
        temporary_root()
