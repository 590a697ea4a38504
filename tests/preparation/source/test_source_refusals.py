"""Sources that are refused as a whole."""

from pathlib import Path

import pytest
from support.source_photos import HEIC_ADVICE, written

from gsfw.core.errors import DataError
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
        f"{tmp_path}: there is no image and no video that can be used; found no files.\n"
        "Give a folder of PNG, JPEG, WEBP, TIFF or BMP images, or a video (.mp4, .mov, .avi, "
        ".mkv, .webm, .m4v)."
    )


def test_a_folder_without_anything_usable_says_what_is_in_it(tmp_path):
    for number in range(3):
        written(tmp_path / f"{number}.heic", b"heic")
    written(tmp_path / "x.jpg", b"")
    written(tmp_path / "list.csv", b"1,2")
    assert refusal(tmp_path) == (
        f"{tmp_path}: there is no image and no video that can be used; found 3 x HEIC files are "
        "not read; 1 x the file is empty (0 bytes); 1 x they are no images and no videos, by "
        f"their names and contents.\n{HEIC_ADVICE}\nCopy it again from the camera."
    )


def test_a_single_file_that_is_no_image_is_refused(tmp_path):
    path = written(tmp_path / "notes.txt", b"text")
    assert refusal(path) == (
        f"{path}: there is no image and no video that can be used; found 1 x it is no PNG, "
        "JPEG, WEBP, TIFF or BMP image, by its content.\nReplace or remove it."
    )


def test_a_folder_that_cannot_be_read_is_refused(tmp_path, monkeypatch):
    def refuse(self: Path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    assert refusal(tmp_path) == (
        f"{tmp_path}: the folder cannot be read (Permission denied).\n"
        "Make it readable, or take it out of the input."
    )
