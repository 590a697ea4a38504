"""Paths of images in the ``transforms`` format."""

import json
from dataclasses import replace

import pytest
from support.small_captures import (
    builder_of,
    projection_error,
    ring,
    write_images,
    write_transforms,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.transforms import TransformsConfig

build = builder_of(TransformsConfig)


@pytest.fixture
def folder(tmp_path):
    """A folder with the images of the ring, which a test adds its transforms.json to."""
    write_images(tmp_path, ring())
    return tmp_path


def write(folder):
    return write_transforms(folder / "transforms.json", ring())


def failure(path) -> DataError:
    with pytest.raises(DataError) as error:
        build(path)
    return error.value


def test_file_paths_may_lack_their_extension_and_use_backslashes(tmp_path):
    write_images(tmp_path / "images", ring())
    names = [f".\\images\\{name.removesuffix('.png')}" for name in ring().names]
    write_transforms(tmp_path / "transforms.json", replace(ring(), names=names))
    assert build(tmp_path).views(Split.TRAIN).names[0] == "images/view_000"


@pytest.mark.parametrize("start", ["./data_b/", "../photos\\new/", "./../../data/scan24/"])
def test_paths_relative_to_another_folder_lead_to_the_images_by_their_ends(folder, start):
    """Paths of colmap2nerf.py (instant-ngp), which writes them relative to its working folder.

    So in github.com/HexGP/nerf-prep, antoniocarevic/diplomski123 and houchenfeng/desplat.
    """
    write(folder)
    content = json.loads((folder / "transforms.json").read_text())
    names = [frame["file_path"] for frame in content["frames"]]
    for frame in content["frames"]:
        frame["file_path"] = start + frame["file_path"]
    content["test_filenames"] = [start + names[0]]
    (folder / "transforms.json").write_text(json.dumps(content))
    data = build(folder)
    assert [frame.name for frame in data.recording.frames] == names
    assert data.views(Split.EVAL).names == (names[0],)
    left_out = start.replace("\\", "/").removeprefix("./")
    note = f"images are found without the beginning of their paths ({left_out})"
    assert note in data.notes()
    assert projection_error(data, ring()) < 0.01


def test_ends_of_paths_that_do_not_tell_images_apart_are_not_used(folder):
    write(folder)
    content = json.loads((folder / "transforms.json").read_text())
    for number, frame in enumerate(content["frames"]):
        frame["file_path"] = f"camera_{number}/{content['frames'][0]['file_path'].split('/')[-1]}"
    (folder / "transforms.json").write_text(json.dumps(content))
    assert f"none of the {len(content['frames'])} images is in" in str(failure(folder))


def test_frames_whose_files_are_missing_are_listed_and_left_out(folder):
    write(folder)
    (folder / "view_002.png").unlink()
    data = build(folder)
    assert data.views(Split.TRAIN).names == ("view_000.png", "view_001.png", "view_003.png")
    assert "1 of 4 images are not on disk and are left out: view_002.png" in data.notes()


def test_a_file_without_any_of_its_images_is_refused(tmp_path):
    write(tmp_path)
    assert f"none of the 4 images is in {tmp_path}" in str(failure(tmp_path))


@pytest.mark.parametrize("stated", ["/", ".", "../../.."])
def test_a_folder_in_the_place_of_an_image_is_a_missing_image(folder, stated):
    content = json.loads(write(folder).read_text())
    content["frames"] = [{**content["frames"][0], "file_path": stated}]
    (folder / "transforms.json").write_text(json.dumps(content))
    assert "none of the 1 images is in" in str(failure(folder))
