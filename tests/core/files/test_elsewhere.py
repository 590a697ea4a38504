"""Files that cannot be written to their place."""

import tempfile

from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.elsewhere import write_here_or_elsewhere


def test_a_file_goes_to_its_place(tmp_path):
    path = tmp_path / "sheet.png"
    assert write_here_or_elsewhere(path, lambda to: write_atomically(to, b"1")) == (str(path), "")
    assert path.read_bytes() == b"1"


def test_or_to_the_temporary_folder_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "file").touch()
    path = tmp_path / "file" / "sheet.png"
    place, said = write_here_or_elsewhere(path, lambda to: write_atomically(to, b"1"))
    assert said == (
        f"{path} cannot be written: File exists. It is {place} instead; out=FILE gives it "
        "another place."
    )
    (written,) = tmp_path.glob("gsfw-*/sheet.png")
    assert (place, written.read_bytes()) == (str(written), b"1")


def test_or_nowhere(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    path = tmp_path / "file" / "sheet.png"
    place, said = write_here_or_elsewhere(path, lambda to: write_atomically(to, b"1"))
    assert (place, said) == (
        "",
        f"{path} cannot be written: File exists. out=FILE gives it another place; out=none "
        "leaves it out.",
    )
