"""Images are found by the names that files of cameras call them."""

from pathlib import Path

import pytest

from gsfw.core.errors import DataError
from gsfw.datamanagers.image_folder import ImageFolder
from gsfw.datamanagers.mask_folder import MaskFolder, stem_of


@pytest.fixture
def folder(tmp_path: Path) -> ImageFolder:
    for name in ("left/1.png", "right/1.png", "2.jpg", "..png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return ImageFolder(tmp_path)


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("2", "2.jpg"),
        ("2.JPG", "2.jpg"),
        ("2.png", "2.jpg"),
        ("C:\\photos\\left\\1.tif", "left/1.png"),
        ("right/1", "right/1.png"),
        ("..png", "..png"),
        (".", None),
        ("..", None),
        ("/", None),
        ("3", None),
    ],
)
def test_an_image_is_found_with_or_without_its_folders_and_extension(folder, name, file):
    assert folder.find(name, "cameras") == (folder.path / file if file else None)


def test_a_name_that_several_images_have_is_refused(folder):
    with pytest.raises(DataError, match=r"cameras: 1 can be any of 2 images"):
        folder.find("1", "cameras")


def test_names_of_dots_only_have_masks_as_others_do(tmp_path):
    assert stem_of(Path("a/..png")) == "a/..png"
    (tmp_path / "..png.png").touch()
    masks = MaskFolder(tmp_path)
    assert masks.files == ()  # It is hidden.
    assert masks.find([Path("..png")]) == tmp_path / "..png.png"
