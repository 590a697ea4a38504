"""COLMAP models of distorted cameras, from their files to the batches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
import torch
from PIL import Image
from support.distorted_images import (
    DISTORTIONS,
    HEIGHT,
    WIDTH,
    lens,
    parameters,
    spot_errors,
    spots,
)
from support.small_captures import SmallCapture, request, ring, write_colmap_cameras, write_image

from gsfw.core.cameras import CameraModel
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.maths.lens import project_points
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.colmap.model import CAMERA_MODELS
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.undistortion import LensRule, undistortion_of

CPU = torch.device("cpu")


def capture_of(views: int) -> SmallCapture:
    """An image for each of the first points, which shows nothing but this point."""
    capture = ring(views)
    return replace(capture, points=capture.points[:views], colors=capture.colors[:views])


def write(folder: Path, cameras: list[Lens], rule: LensRule | None = None) -> SmallCapture:
    """A COLMAP data set with one image of each camera; spots are round as ``rule`` has them."""
    capture = capture_of(len(cameras))
    numbered = {
        number: (camera.model, camera.width, camera.height, parameters(camera))
        for number, camera in enumerate(cameras, 1)
    }
    write_colmap_cameras(folder / "sparse/0", capture, numbered, list(numbered))
    (folder / "images").mkdir()
    for pose, point, name, camera in zip(
        capture.poses, capture.points, capture.names, cameras, strict=True
    ):
        local = pose[:3, :3] @ point + pose[:3, 3]
        target = camera if camera.is_pinhole else undistortion_of(camera, rule or LensRule()).target
        image = spots(camera, target, (local[:2] / local[2])[None])
        Image.fromarray(image).save(folder / "images" / name)
    return capture


def point_errors(data: DataManager) -> float:
    """Pixels between where images show their points and where rasterizers put them; the worst."""
    views, points = data.views(Split.TRAIN), data.scene.points
    worst = 0.0
    for index, (camera, point) in enumerate(zip(views.cameras, points, strict=True)):
        (batch,) = data.load(Split.TRAIN, [index], CPU)
        assert batch.images.shape[1:3] == (camera.height, camera.width)
        pose = camera.world_to_camera[0]
        local = (pose[:3, :3] @ point + pose[:3, 3])[None]
        pixels, _ = project_points(local, camera, margin=1.0)
        expected = pixels.double().numpy()
        errors = spot_errors(batch.images[0].numpy() * 255, expected)
        worst = max(worst, float(np.abs(errors).max()))
    return worst


@pytest.mark.parametrize("model", DISTORTIONS)
def test_points_show_where_the_cameras_put_them(tmp_path, model):
    write(tmp_path, [lens(model)] * 2)
    data = ColmapConfig().build(request(tmp_path))
    assert point_errors(data) < 0.01
    assert all(camera.model is CameraModel.PINHOLE for camera in data.views(Split.TRAIN).cameras)


def test_cameras_of_several_models_and_sizes_share_a_set(tmp_path):
    pinhole = lens("PINHOLE", ())
    cameras = [lens("OPENCV"), pinhole, lens("FISHEYE"), lens("FOV").resized(320, 240)]
    write(tmp_path, cameras)
    data = ColmapConfig().build(request(tmp_path))
    assert point_errors(data) < 0.01
    views = data.views(Split.TRAIN)
    sizes = [(camera.width, camera.height) for camera in views.cameras]
    assert sizes[1] == (WIDTH, HEIGHT)
    assert len(set(sizes)) == 4
    assert [int(camera.camera_index[0]) for camera in views.cameras] == [0, 1, 2, 3]
    assert [note.split(" (")[0] for note in data.notes()[1:4]] == [
        f"1 image of 1 lens undistorted from {model} to PINHOLE"
        for model in ("OPENCV", "FISHEYE", "FOV")
    ]


def test_downscaled_images_follow_the_undistorted_camera(tmp_path):
    write(tmp_path, [lens("OPENCV")] * 2)
    full = ColmapConfig().build(request(tmp_path)).views(Split.TRAIN).cameras[0]
    data = ColmapConfig().build(request(tmp_path, downscale=2.0))
    small = data.views(Split.TRAIN).cameras[0]
    assert (small.width, small.height) == (round(full.width / 2), round(full.height / 2))
    ratio = small.width / full.width
    assert float(small.intrinsics[0, 0, 2]) == pytest.approx(ratio * full.intrinsics[0, 0, 2])
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    assert batch.images.shape == (2, small.height, small.width, 3)


def test_images_smaller_than_their_camera_are_undistorted_as_they_are(tmp_path):
    capture = write(tmp_path, [lens("OPENCV")] * 2)
    full = ColmapConfig().build(request(tmp_path)).views(Split.TRAIN).cameras[0]
    for name in capture.names:
        write_image(tmp_path / "images" / name, WIDTH // 2, HEIGHT // 2)
    data = ColmapConfig().build(request(tmp_path))
    small = data.views(Split.TRAIN).cameras[0]
    assert (small.width, small.height) == (full.width // 2, full.height // 2)
    assert float(small.intrinsics[0, 0, 0]) == pytest.approx(float(full.intrinsics[0, 0, 0]) / 2)
    assert data.load(Split.TRAIN, [0], CPU)[0].images.shape == (1, small.height, small.width, 3)


def test_fisheyes_may_be_kept_and_then_their_cameras_are_fisheyes(tmp_path):
    cameras = [lens("OPENCV_FISHEYE"), lens("OPENCV")]
    write(tmp_path, cameras, LensRule(keep_fisheye=True))
    data = ColmapConfig(fisheye="keep").build(request(tmp_path))
    assert point_errors(data) < 0.01
    models = [camera.model for camera in data.views(Split.TRAIN).cameras]
    assert models == [CameraModel.FISHEYE, CameraModel.PINHOLE]


def test_blank_pixels_are_masked_out(tmp_path):
    write(tmp_path, [lens("OPENCV")] * 2)
    data = ColmapConfig(blank_pixels=1.0).build(request(tmp_path))
    assert point_errors(data) < 0.01
    (batch,) = data.load(Split.TRAIN, [0], CPU)
    assert batch.valid is not None
    assert 0.5 < float(batch.valid.float().mean()) < 1.0
    assert "and pixels that no lens saw are masked out" in data.notes()[1]


def test_a_lens_that_folds_its_image_over_names_its_camera(tmp_path):
    folding = lens("SIMPLE_RADIAL", (-1.5,))
    write(tmp_path, [lens("OPENCV")])
    numbered = {1: (folding.model, WIDTH, HEIGHT, parameters(folding))}
    write_colmap_cameras(tmp_path / "sparse/0", capture_of(1), numbered, [1])
    with pytest.raises(DataError) as error:
        ColmapConfig().build(request(tmp_path))
    assert str(error.value).startswith(
        f"camera 1 of {tmp_path}/sparse/0/cameras.bin: its distortion, SIMPLE_RADIAL (k1=-1.5), "
        "folds the image over: "
    )


def test_panoramas_are_refused(tmp_path):
    cameras = {1: ("EQUIRECTANGULAR", 200, 100, (200.0, 100.0))}
    write_colmap_cameras(tmp_path, ring(1), cameras, [1])
    write_image(tmp_path / "images/view_000.png", 200, 100)
    with pytest.raises(DataError) as error:
        ColmapConfig().build(request(tmp_path))
    assert str(error.value) == (
        f"camera 1 of {tmp_path}/cameras.bin: images of the model EQUIRECTANGULAR cannot be "
        "trained on.\nCut them into images of pinhole cameras first: a panorama has no image "
        "plane."
    )


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_parameters_that_are_not_finite_name_their_camera(tmp_path, value):
    params = (*parameters(lens("OPENCV"))[:-1], value)
    cameras = {1: ("OPENCV", WIDTH, HEIGHT, params)}
    write_colmap_cameras(tmp_path, ring(1), cameras, [1])
    write_image(tmp_path / "images/view_000.png", WIDTH, HEIGHT)
    with pytest.raises(DataError, match=r"camera 1 of .*cameras\.bin: its distortion, OPENCV"):
        ColmapConfig().build(request(tmp_path))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fisheye": "yes"}, "datamanager.fisheye=yes: expected undistort or keep."),
        (
            {"field_of_view": 180.0},
            "datamanager.field_of_view=180: expected degrees up to 160.\n"
            "datamanager.fisheye=keep shows more of a fisheye lens.",
        ),
    ],
)
def test_settings_out_of_range_are_refused(tmp_path, settings, message):
    with pytest.raises(ConfigError) as error:
        ColmapConfig(**settings).build(request(tmp_path))
    assert str(error.value) == message


def test_models_have_the_numbers_and_parameters_that_colmap_gives_them():
    known = {model.name: model.value for model in pycolmap.CameraModelId.__members__.values()}
    for number, (name, count) in enumerate(CAMERA_MODELS):
        assert known[name] == number
        camera = pycolmap.Camera.create_from_model_name(1, name, 1.0, 2, 2)
        assert len(camera.params) == count
