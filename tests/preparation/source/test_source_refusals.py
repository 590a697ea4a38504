"""Sources that are refused as a whole."""

from pathlib import Path

import pytest
from support.source_photos import HEIC_ADVICE, written

from gsfw.core.errors import DataError
from gsfw.preparation.foreign_formats import RAW
from gsfw.preparation.source import read_source


def refusal(*paths: Path) -> str:
    with pytest.raises(DataError) as caught:
        read_source(paths)
    return str(caught.value)


def test_a_path_that_is_not_there_is_refused_with_the_nearest(folder):
    path = folder.parent / "shosts"
    assert refusal(path) == f"{path}: there is no such file or folder.\nDid you mean 'shots'?"
    path = folder.parent / "gone" / "x"
    assert refusal(folder, path) == (
        f"{path}: there is no such file or folder.\nGive a folder of photos, or a video."
    )


def test_an_empty_folder_is_refused(tmp_path):
    assert refusal(tmp_path) == (
        f"{tmp_path}: there is no image and no video that can be used. There are no files.\n"
        "Give a folder of PNG, JPEG, WEBP, TIFF or BMP images, or a video (.mp4, .mov, .avi, "
        ".mkv, .webm, .m4v)."
    )


def test_a_folder_without_anything_usable_says_what_is_in_it(tmp_path):
    for number in range(3):
        written(tmp_path / f"{number}.heic", b"heic")
    written(tmp_path / "x.jpg", b"")
    written(tmp_path / "list.csv", b"1,2")
    assert refusal(tmp_path) == (
        f"{tmp_path}: there is no image and no video that can be used. gsfw found 3 HEIC "
        "files, which it does not read; and 1 file that is no image and no video, by name and "
        f"content. x.jpg: the file is empty (0 bytes).\n0.heic, 1.heic, 2.heic: {HEIC_ADVICE}\n"
        "x.jpg: Copy it again from the camera."
    )


def test_formats_that_are_not_read_are_counted_with_their_remedies(tmp_path):
    written(tmp_path / "a.dng", b"raw")
    for name in ("b", "c"):
        written(tmp_path / f"{name}.heic", b"heic")
    said = refusal(tmp_path)
    found = "gsfw found 2 HEIC files and 1 camera RAW file, which it does not read."
    assert said.splitlines()[0].endswith(f"can be used. {found}")
    assert said.splitlines()[1:] == [f"a.dng: {RAW.advice}", f"b.heic, c.heic: {HEIC_ADVICE}"]


def test_a_single_file_that_is_no_image_is_refused(tmp_path):
    path = written(tmp_path / "notes.txt", b"text")
    assert refusal(path) == (
        f"{path}: there is no image and no video that can be used. notes.txt: it is no "
        "PNG, JPEG, WEBP, TIFF or BMP image, by its content.\nReplace or remove it."
    )


def test_a_folder_that_cannot_be_read_is_refused(tmp_path, monkeypatch):
    def refuse(self: Path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    assert refusal(tmp_path) == (
        f"{tmp_path}: the folder cannot be read (Permission denied).\n"
        "Make it readable, or take it out of the input."
    )


def test_a_folder_in_a_folder_that_may_not_be_searched_is_refused(folder, monkeypatch):
    (folder / "sub").mkdir()

    def refused_below(call):
        def answer(path, *rest):
            if folder / "sub" in (path, path.parent):
                raise PermissionError(13, "Permission denied", str(path))
            return call(path, *rest)

        return answer

    monkeypatch.setattr(Path, "is_file", refused_below(Path.is_file))
    monkeypatch.setattr(Path, "iterdir", refused_below(Path.iterdir))
    with pytest.raises(DataError, match=r"sub: the folder cannot be read \(Permission denied\)"):
        read_source([folder])
