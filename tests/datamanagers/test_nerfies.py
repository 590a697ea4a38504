"""The ``nerfies`` format."""

import json

import numpy as np
import pytest
import torch
from support.captures.nerfies import ASPECT, CENTER, FOCAL, NAMES, capture, write
from support.small_captures import HEIGHT, WIDTH, builder_of, projection_error

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.nerfies import NerfiesConfig

build = builder_of(NerfiesConfig)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, capture()) < 0.01
    world = data.scene.world_from_scene.apply(data.scene.points.double())
    torch.testing.assert_close(world, torch.from_numpy(capture().points), atol=1e-5, rtol=0)


def test_the_split_times_and_cameras_are_the_data_sets_own(tmp_path):
    data = build(write(tmp_path))
    assert data.views(Split.TRAIN).names == tuple(NAMES[i] for i in (0, 2, 4))
    assert data.views(Split.EVAL).names == tuple(NAMES[i] for i in (1, 3))
    assert data.views(Split.EVAL).times == (0.25, 0.75)
    assert (data.scene.time_range, data.scene.num_times) == ((0.0, 12.0), 5)
    assert [int(camera.camera_index[0]) for camera in data.views(Split.EVAL).cameras] == [1, 1]
    assert data.notes() == (
        f"{tmp_path}/dataset.json: 5 frames, images of {tmp_path}/rgb/1x (1/1 of full size)",
        "20 points",
        "held-out views: the data set's own split",
    )


def test_time_id_goes_before_warp_id(tmp_path):
    metadata = {name: {"warp_id": 0, "time_id": number} for number, name in enumerate(NAMES)}
    (write(tmp_path) / "metadata.json").write_text(json.dumps(metadata))
    assert build(tmp_path).scene.time_range == (0.0, 4.0)


@pytest.mark.parametrize(
    ("downscale", "folder", "size"),
    [(1, "1x", (64, 48)), (2, "2x", (32, 24)), (3, "2x", (21, 16)), (4, "4x", (16, 12))],
)
def test_the_folder_is_chosen_by_downscale(tmp_path, downscale, folder, size):
    data = build(write(tmp_path, scales=(1, 2, 4)), downscale=float(downscale))
    assert f"rgb/{folder} " in data.notes()[0]
    camera = data.views(Split.TRAIN).cameras[0]
    assert (camera.width, camera.height) == size
    assert float(camera.intrinsics[0, 0, 0]) == pytest.approx(FOCAL * size[0] / WIDTH)


def test_without_the_full_size_the_largest_there_is_is_used(tmp_path):
    data = build(write(tmp_path, scales=(2, 4)))
    assert f"images of {tmp_path}/rgb/2x (1/2 of full size)" in data.notes()[0]
    assert projection_error(data, capture(), 0.5) < 0.01


def test_distorted_lenses_are_undistorted_with_their_own_formula(tmp_path):
    k1, k2, k3, p1, p2 = 0.05, -0.02, 0.004, 0.003, -0.002
    camera = {"radial_distortion": [k1, k2, k3], "tangential_distortion": [p1, p2]}
    data = build(write(tmp_path, camera=camera))
    assert any("undistorted from FULL_OPENCV to PINHOLE" in note for note in data.notes())
    lens = data._frames[0].lens
    x, y = 0.2, -0.3
    r = x * x + y * y
    d = 1 + r * (k1 + r * (k2 + r * k3))
    expected = [
        FOCAL * (d * x + 2 * p1 * x * y + p2 * (r + 2 * x * x)) + CENTER[0],
        FOCAL * ASPECT * (d * y + 2 * p2 * x * y + p1 * (r + 2 * y * y)) + CENTER[1],
    ]
    assert lens.project(np.array([[x, y]]))[0] == pytest.approx(expected, abs=1e-6)


def test_the_older_name_of_tangential_distortion_is_known(tmp_path):
    camera = {"tangential_distortion": None, "tangential": [0.01, 0.0]}
    assert build(write(tmp_path, camera=camera))._frames[0].lens.distortion[2] == 0.01


def test_without_val_ids_images_are_held_out_as_any_others(tmp_path):
    data = build(write(tmp_path, held=()), eval_every_nth=3)
    assert data.views(Split.EVAL).names == (NAMES[0],)
    assert data.views(Split.TRAIN).names == (NAMES[2], NAMES[4])
    assert "2 frames are neither in train_ids nor in val_ids: left out" in data.notes()


def test_images_that_are_not_on_disk_are_left_out(tmp_path):
    write(tmp_path)
    (tmp_path / f"rgb/1x/{NAMES[2]}.png").unlink()
    data = build(tmp_path)
    assert len(data.views(Split.TRAIN)) == 2
    assert f"1 of 5 images are not on disk and are left out: {NAMES[2]}" in data.notes()


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"skew": 0.5}, r"the camera is skewed \(skew=0\.5\); expected 0"),
        ({"focal_length": "x"}, r"focal_length: expected one finite number, found 'x'"),
        ({"position": [1.0, 2.0]}, r"position: expected 3 finite numbers, found \[1\.0, 2\.0\]"),
        ({"orientation": np.diag([1.0, 1.0, 2.0]).tolist()}, r"the pose is not rigid"),
        ({"focal_length": -1.0}, r"fx=-1, .* is no camera"),
        ({"focal_length": 10**400}, r"focal_length: expected one finite number, found 10+"),
        (
            {"image_size": [np.inf, HEIGHT]},
            r"image_size\[0\]: expected one finite number, found inf",
        ),
        (
            {"image_size": [WIDTH, np.nan]},
            r"image_size\[1\]: expected one finite number, found nan",
        ),
    ],
)
def test_cameras_that_are_none_are_refused(tmp_path, camera, message):
    with pytest.raises(DataError, match=rf"left1_000000\.json.*{message}"):
        build(write(tmp_path, camera=camera))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("dataset.json", '{"train_ids": ', r"dataset\.json cannot be read as JSON"),
        ("dataset.json", "[]", r"dataset\.json: expected an object, found \[\]"),
        ("dataset.json", '{"train_ids": 3}', r"train_ids: expected a list of texts, found 3"),
        ("dataset.json", "{}", r"dataset\.json lists no frames"),
        ("metadata.json", "{}", r"metadata\.json does not have left1_000000"),
        (
            "metadata.json",
            '{"left1_000000": {}}',
            r"left1_000000: time_id or warp_id is missing; expected a whole number of at least 0",
        ),
        ("metadata.json", '{"left1_000000": 3}', r"left1_000000: expected an object, found 3"),
        ("metadata.json", '{"left1_000000": {"time_id": 1.5}}', r"a whole number .*, found 1\.5"),
        ("metadata.json", '{"left1_000000": {"time_id": true}}', r"a whole number .*, found True"),
        ("camera/left1_000000.json", "", r"left1_000000\.json cannot be read as JSON"),
        ("points.npy", "x", r"points\.npy does not hold points"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, content, message):
    (write(tmp_path) / name).write_text(content)
    with pytest.raises(DataError, match=message):
        build(tmp_path)


def test_a_camera_number_that_is_too_large_is_refused(tmp_path):
    metadata = {name: {"warp_id": 0, "camera_id": 2**63} for name in NAMES}
    (write(tmp_path) / "metadata.json").write_text(json.dumps(metadata))
    with pytest.raises(DataError, match=r"camera_id: expected a whole number .*, found 9223"):
        build(tmp_path)


def test_without_images_it_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"contains no images: there is no rgb/1x, rgb/2x"):
        build(write(tmp_path, scales=()))


def test_the_format_is_told_by_names(tmp_path):
    assert NerfiesConfig.detect(write(tmp_path / "a")).recognised
    assert not NerfiesConfig.detect(tmp_path).recognised
