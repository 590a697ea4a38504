"""Which files of folders belong to a source."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from support.source_photos import names, photo, photos, written

from gsfw.core.progress import Advance, shown_by
from gsfw.preparation.source import read_source


def test_what_another_preparation_has_only_begun_is_not_used(folder):
    photo(folder / "scene" / "work" / "frames" / "c.png")
    (folder / "scene" / "work" / "stages.json").touch()
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png"]
    assert source.notes == (f"{folder / 'scene'} is not used: it is a result of gsfw prepare",)


def test_of_a_result_only_its_images_are_used(tmp_path):
    photos(tmp_path / "images", "a.png")
    photos(tmp_path, "prepare.png", "work/frames/b.png")
    (tmp_path / "prepare.json").touch()
    source = read_source([tmp_path])
    assert names(source) == ["a.png"]
    assert source.notes == (f"{tmp_path}: only images/ is used, as it is a result of gsfw prepare",)


def test_folders_in_a_folder_are_groups(tmp_path):
    photos(tmp_path, "cam10/a.png", "cam2/a.png", "cam2/deep/a.png", "a.png")
    source = read_source([tmp_path])
    assert names(source) == ["a.png", "cam2/a.png", "cam2/deep/a.png", "cam10/a.png"]
    groups = [image.group for image in source.images.images]
    assert groups == ["", "cam2", "cam2/deep", "cam10"]


def test_a_single_folder_in_a_folder_is_no_group(tmp_path):
    source = read_source([photos(tmp_path, "day/a.png", "day/b.png")])
    assert names(source) == ["day/a.png", "day/b.png"]
    assert {image.group for image in source.images.images} == {""}


@pytest.mark.parametrize("inner", ["images", "input"])
def test_the_image_folder_of_a_data_set_is_entered(tmp_path, inner):
    photos(tmp_path, f"{inner}/a.png")
    written(tmp_path / "sparse" / "0" / "cameras.bin", b"1234")
    source = read_source([tmp_path])
    assert names(source) == ["a.png"]
    assert source.notes == ()


def test_shrunk_copies_beside_the_images_of_a_data_set_are_not_read(tmp_path):
    photos(tmp_path, "images/a.png", "images_2/a.png", "masks/a.png")
    source = read_source([tmp_path])
    assert names(source) == ["a.png"]
    assert source.notes == (
        f"{tmp_path}: only images/ is used; name the folders beside it as inputs of their own if "
        "they hold other photos (images_2)",
    )


def test_results_beside_the_images_of_a_data_set_are_no_photos(tmp_path):
    photos(tmp_path, "images/a.png", "out/images/a.png", "old/images/a.png")
    written(tmp_path / "old" / "prepare.json", b"{}")
    source = read_source([tmp_path], apart=[tmp_path / "out"])
    assert (names(source), source.notes) == (["a.png"], ())


def test_a_mask_beside_the_images_of_a_data_set_does_not_change_what_is_read(tmp_path):
    photos(tmp_path, "images/a.png", "input/b.png", "operator.png")
    assert names(read_source([tmp_path], apart=[tmp_path / "operator.png"])) == ["b.png"]


def test_raw_input_comes_before_images_that_were_made_of_it(tmp_path):
    photos(tmp_path, "images/a.png", "input/b.png")
    assert names(read_source([tmp_path])) == ["b.png"]


def test_images_is_a_folder_like_others_where_images_lie_beside_it(tmp_path):
    photos(tmp_path, "a.png", "images/b.png")
    assert names(read_source([tmp_path])) == ["a.png", "images/b.png"]


def test_single_images_can_be_given(tmp_path):
    photos(tmp_path, "a.png", "b.png", "c.png")
    source = read_source([tmp_path / "c.png", tmp_path / "a.png"])
    assert names(source) == ["a.png", "c.png"]


def test_what_is_given_twice_is_used_once(tmp_path):
    photos(tmp_path, "a.png", "sub/b.png")
    for paths in (
        [tmp_path, tmp_path],
        [tmp_path, tmp_path / "a.png"],
        [tmp_path, tmp_path / "sub" / "b.png"],
    ):
        source = read_source(paths)
        assert names(source) == ["a.png", "sub/b.png"]
        assert source.images.left_out == ()
    assert len(read_source([tmp_path / "sub", tmp_path]).images.images) == 2


def test_a_link_back_does_not_lead_in_circles(folder):
    (folder / "again").symlink_to(folder, target_is_directory=True)
    assert names(read_source([folder])) == ["a.png", "b.png"]


def test_what_systems_leave_behind_is_not_looked_at(folder):
    for name in (".hidden.png", ".trash/x.png", "__MACOSX/x.png", "@eaDir/x.png"):
        photo(folder / name)
    written(folder / "Thumbs.db", b"1")
    photo(folder / "GX01.THM", content="JPEG")
    written(folder / ".DS_Store", b"1")
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png"]
    assert source.images.left_out == ()
    assert source.notes == ()


def test_results_and_masks_in_a_folder_are_not_read(folder):
    photos(folder, "out/images/a.png", "old/images/a.png", "masks/a.png")
    written(folder / "old" / "prepare.json", b"{}")
    source = read_source([folder], apart=[folder / "out"])
    assert names(source) == ["a.png", "b.png"]
    assert source.notes == (
        f"{folder / 'masks'} is not searched for photos, because its name is masks; only masks of "
        "panoramas are used",
        f"{folder / 'old'} is not used: it is a result of gsfw prepare",
    )


def test_photos_that_need_no_conversion_take_no_stage(folder):
    stages: list[str] = []

    @contextmanager
    def show(name: str, total: int) -> Iterator[Advance]:
        stages.append(name)
        yield lambda done: None

    with shown_by(show):
        read_source([folder], converted=folder / "converted")
    assert stages == []


def test_other_files_are_counted_only(folder):
    for name in ("list.csv", "a.xmp", "b.xmp", "empty.txt", "LICENSE"):
        written(folder / name, b"" if name == "empty.txt" else b"text")
    source = read_source([folder])
    assert source.images.left_out == ()
    assert source.notes == (
        "files that hold no image are not used: 5 (.csv, .txt, .xmp, no extension)",
    )
