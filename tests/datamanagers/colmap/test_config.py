"""The ``colmap`` format."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from support.small_captures import (
    CENTER,
    FOCAL,
    HEIGHT,
    WIDTH,
    projection_error,
    request,
    ring,
    write_colmap,
    write_colmap_cameras,
    write_image,
    write_images,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.config import ColmapConfig


def build(path, config=None, **settings):
    return (config or ColmapConfig()).build(request(path, **settings))


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
@pytest.mark.parametrize("folder", ["sparse/0", "sparse", "."])
def test_points_fall_where_they_should(tmp_path, suffix, folder):
    capture = ring(5, 3.0, origin=(40.0, -20.0, 7.0))
    write_colmap(tmp_path / folder, capture, suffix)
    write_images(tmp_path / "images", capture)
    data = build(tmp_path, eval_every_nth=3)
    assert data.views(Split.EVAL).names == ("view_000.png", "view_003.png")
    assert projection_error(data, capture) < 0.01
    assert data.scene.name == tmp_path.name
    assert np.allclose(data.scene.point_colors.numpy(), capture.colors / 255)


def test_the_folder_of_the_model_finds_the_images_beside_it(tmp_path):
    write_colmap(tmp_path / "sparse/0", ring())
    write_images(tmp_path / "images", ring())
    for folder in ("sparse/0", "sparse"):
        data = build(tmp_path / folder)
        assert len(data.views(Split.TRAIN)) == 4
        assert data.scene.name == tmp_path.name


def test_georeferenced_cameras_see_the_same_pixels(tmp_path):
    capture = ring(6, 30.0, origin=(5e6, 4.9e6, 300.0))
    write_colmap(tmp_path / "sparse/0", capture)
    write_images(tmp_path / "images", capture)
    assert projection_error(build(tmp_path), capture) < 0.01


@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_scenes_of_any_size_see_the_same_pixels(tmp_path, size):
    capture = ring(4, size)
    write_colmap(tmp_path, capture)
    write_images(tmp_path / "images", capture)
    assert projection_error(build(tmp_path), capture) < 0.01


def test_downscaled_cameras_see_the_points_at_the_scale(tmp_path):
    write_colmap(tmp_path, ring())
    write_images(tmp_path / "images", ring())
    data = build(tmp_path, downscale=4.0)
    assert projection_error(data, ring(), scale=0.25) < 0.01
    (batch,) = data.load(Split.TRAIN, [0, 1, 2, 3], torch.device("cpu"))
    assert batch.images.shape == (4, HEIGHT // 4, WIDTH // 4, 3)


def test_images_that_are_already_smaller_scale_the_cameras(tmp_path):
    write_colmap(tmp_path, ring())
    write_images(tmp_path / "images_2", ring(), WIDTH // 2, HEIGHT // 2)
    data = build(tmp_path, ColmapConfig(images="images_2"))
    assert projection_error(data, ring(), scale=0.5) < 0.01


def test_several_cameras_sizes_and_folders_share_a_model(tmp_path):
    capture = replace(ring(3), names=["left/a.png", "left/b.png", "right/a.png"])
    cameras = {
        4: ("PINHOLE", WIDTH, HEIGHT, (*FOCAL, *CENTER)),
        9: ("SIMPLE_PINHOLE", 40, 30, (50.0, 20.0, 15.0)),
    }
    write_colmap_cameras(tmp_path / "sparse/0", capture, cameras, [4, 4, 9])
    write_image(tmp_path / "images/left/a.png")
    write_image(tmp_path / "images/left/b.png")
    write_image(tmp_path / "images/right/a.png", 40, 30)
    data = build(tmp_path)
    batches = data.load(Split.TRAIN, [0, 2, 1], torch.device("cpu"))
    assert [batch.views for batch in batches] == [(0, 1), (2,)]
    assert [tuple(batch.images.shape[1:3]) for batch in batches] == [(48, 64), (30, 40)]
    assert batches[0].cameras.camera_index.tolist() == [0, 0]
    assert batches[1].cameras.camera_index.tolist() == [1]
    assert batches[1].cameras.intrinsics[0, 0].tolist() == [50.0, 0.0, 20.0]


def test_images_that_are_missing_are_listed_and_left_out(tmp_path):
    write_colmap(tmp_path, ring())
    write_images(tmp_path / "images", ring())
    (tmp_path / "images/view_001.png").unlink()
    data = build(tmp_path)
    assert data.views(Split.TRAIN).names == ("view_000.png", "view_002.png", "view_003.png")
    assert data.notes() == (
        f"{tmp_path}/cameras.bin: 4 images, 20 points",
        "1 of 4 images are not on disk and are left out: view_001.png",
        "held-out views: none (as asked for)",
    )


def test_a_model_whose_images_are_all_missing_is_refused(tmp_path):
    write_colmap(tmp_path, ring())
    (tmp_path / "images").mkdir()
    with pytest.raises(DataError, match=r"none of the 4 images is in .*/images \(looked for vi"):
        build(tmp_path)


def test_a_folder_of_images_that_does_not_exist_is_refused(tmp_path):
    write_colmap(tmp_path, ring())
    with pytest.raises(DataError, match=r"datamanager\.images=photos: there is no folder .*photos"):
        build(tmp_path, ColmapConfig(images="photos"))


def test_of_several_models_the_largest_is_used(tmp_path):
    write_colmap(tmp_path / "sparse/0", ring(2))
    write_colmap(tmp_path / "sparse/1", ring(6))
    write_images(tmp_path / "images", ring(6))
    data = build(tmp_path)
    assert len(data.views(Split.TRAIN)) == 6
    assert data.notes()[1] == (f"used the largest of 2 models; the others are {tmp_path}/sparse/0")


def test_a_model_without_images_is_refused(tmp_path):
    write_colmap(tmp_path, replace(ring(), poses=[], names=[]))
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert str(error.value) == (
        f"{tmp_path}/images.bin contains no images: COLMAP has placed no camera.\n"
        "Look at COLMAP's log; it needs images that overlap and show texture."
    )


def test_a_model_with_only_some_of_its_files_is_refused(tmp_path):
    write_colmap(tmp_path, ring())
    (tmp_path / "images.bin").unlink()
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert str(error.value) == (
        f"{tmp_path} holds cameras.bin, but there is no images.bin beside it.\n"
        "Copy the whole model: cameras, images and points3D."
    )


def test_a_model_without_points_has_none(tmp_path):
    write_colmap(tmp_path, ring())
    write_images(tmp_path / "images", ring())
    (tmp_path / "points3D.bin").unlink()
    assert build(tmp_path).scene.points.shape == (0, 3)


def test_points_that_are_not_finite_are_refused(tmp_path):
    capture = ring()
    capture.points[3, 1] = np.nan
    write_colmap(tmp_path, capture)
    with pytest.raises(DataError, match=r"points3D\.bin is cut off or damaged: some of its points"):
        build(tmp_path)


def test_an_image_of_an_unknown_camera_is_refused(tmp_path):
    cameras = {1: ("PINHOLE", WIDTH, HEIGHT, (*FOCAL, *CENTER))}
    write_colmap_cameras(tmp_path, ring(2), cameras, [1, 5])
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert error.value.message == (
        f"{tmp_path}/images.bin is cut off or damaged: view_001.png was taken by camera 5, "
        "which cameras.bin does not have."
    )


def test_a_distortion_of_zero_is_a_pinhole(tmp_path):
    params = (*FOCAL, *CENTER, 0.0, 0.0, 0.0, 0.0)
    write_colmap(tmp_path, ring(), model="OPENCV", params=params)
    write_images(tmp_path / "images", ring())
    assert projection_error(build(tmp_path), ring()) < 0.01


def test_an_image_of_another_size_is_refused_with_both_sizes(tmp_path):
    write_colmap(tmp_path, ring())
    write_images(tmp_path / "images", ring())
    write_image(tmp_path / "images/view_002.png", 60, 48)
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert error.value.message == (
        f"{tmp_path}/images/view_002.png is 60x48 pixels, but camera 1 of {tmp_path}/cameras.bin "
        "describes 64x48."
    )


def test_images_are_turned_upright_before_sizes_are_compared(tmp_path):
    write_colmap(tmp_path, ring())
    exif = Image.Exif()
    exif[274] = 6
    for name in ring().names:
        path = tmp_path / "images" / name
        path.parent.mkdir(exist_ok=True)
        Image.new("RGB", (HEIGHT, WIDTH)).save(path, exif=exif)
    (batch,) = build(tmp_path).load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape == (1, HEIGHT, WIDTH, 3)


def test_images_beside_the_model_are_found_too(tmp_path):
    write_colmap(tmp_path, ring())
    write_images(tmp_path, ring())
    assert len(build(tmp_path).views(Split.TRAIN)) == 4


def test_a_folder_without_a_model_says_what_was_looked_for(tmp_path):
    write_images(tmp_path / "images", ring())
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert error.value.message.startswith(
        f"{tmp_path} contains no COLMAP model; looked for cameras, images and points3D (.bin or "
        ".txt) in sparse/0, in sparse, or in the folder; found 4 images in images/, but no "
        "cameras; "
    )
    shutil.rmtree(tmp_path / "images")
    with pytest.raises(DataError, match=r"in the folder\.\nGive the folder that holds sparse/ and"):
        build(tmp_path)
