"""The ``llff`` format."""

import numpy as np
import pytest
import torch
from support.captures.llff import centred, write
from support.refusals import failure_of
from support.small_captures import HEIGHT, WIDTH, builder_of, projection_error, ring, write_image

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.llff import LlffConfig
from gsfw.datamanagers.neural_3d_video import Neural3DVideoConfig

build = builder_of(LlffConfig)
failure = failure_of(build)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path, ring()))
    assert projection_error(data, centred(ring())) < 0.01
    assert projection_error(build(tmp_path / "poses_bounds.npy"), centred(ring())) < 0.01
    assert data.notes()[0] == (
        f"{tmp_path}/poses_bounds.npy: 4 cameras, images of {tmp_path}/images (1/1 of full "
        "size); the nearest and farthest depths are not used"
    )


@pytest.mark.parametrize(("downscale", "folder", "left"), [(4, 4, 1), (6, 4, 1.5), (2, 1, 2)])
def test_downscale_takes_the_images_that_were_shrunk_no_more(tmp_path, downscale, folder, left):
    data = build(write(tmp_path, ring(), (1, 4, 8)), downscale=float(downscale))
    assert f"(1/{folder} of full size)" in data.notes()[0]
    camera = data.views(Split.TRAIN).cameras[0]
    assert (camera.width, camera.height) == (round(64 / folder / left), round(48 / folder / left))
    if downscale != 6:
        assert projection_error(data, centred(ring()), 1 / downscale) < 0.01


def test_shrunk_images_alone_are_enough(tmp_path):
    data = build(write(tmp_path, ring(), (8,)))
    assert projection_error(data, centred(ring()), 1 / 8) < 0.01


def test_a_folder_of_images_may_be_named(tmp_path):
    write(tmp_path, ring(), (1, 4))
    data = build(tmp_path, {"images": "images_4"})
    assert projection_error(data, centred(ring()), 1 / 4) < 0.01
    with pytest.raises(DataError, match=r"datamanager.images=photos: there is no folder"):
        build(tmp_path, {"images": "photos"})


def test_images_decode(tmp_path):
    data = build(write(tmp_path, ring()))
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape == (1, HEIGHT, WIDTH, 3)


def test_an_image_too_many_is_refused(tmp_path):
    write(tmp_path, ring())
    write_image(tmp_path / "images/zz.png")
    assert "has 4 cameras, but there are 5 images in" in failure(tmp_path)
    assert "images that LLFF left out have to be removed." in failure(tmp_path)


def test_malformed_files_are_refused(tmp_path):
    write(tmp_path, ring())
    (tmp_path / "poses_bounds.npy").write_bytes(b"\x93NUMPY\x01\x00")
    assert "poses_bounds.npy cannot be read" in failure(tmp_path)
    np.save(tmp_path / "poses_bounds.npy", np.full((4, 17), np.nan))
    assert "row 0 (view_000.png): its size is nanxnan pixels." in failure(tmp_path)
    np.save(tmp_path / "poses_bounds.npy", np.ones((4, 17)))
    assert "row 0 (view_000.png): the pose is not rigid" in failure(tmp_path)
    (tmp_path / "poses_bounds.npy").unlink()
    assert f"{tmp_path} contains no poses_bounds.npy." in failure(tmp_path)
    assert "contains no images: there is no images/" in failure(tmp_path.parent)


def test_videos_of_cameras_are_another_format(tmp_path):
    still = write(tmp_path / "still", ring())
    assert LlffConfig.detect(still).found == "poses_bounds.npy with images/"
    assert not Neural3DVideoConfig.detect(still).recognised
    moving = write(tmp_path / "moving", ring(), ())
    write_image(moving / "cam00/images/0000.png")
    assert Neural3DVideoConfig.detect(moving).recognised
    assert not LlffConfig.detect(moving).recognised
