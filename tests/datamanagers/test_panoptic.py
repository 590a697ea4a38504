"""The ``panoptic`` format."""

import numpy as np
import pytest
import torch
from support.captures.panoptic import TIMES, capture, name, write
from support.small_captures import HEIGHT, WIDTH, projection_error, request

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.panoptic import PanopticConfig


def build(path, **config):
    return PanopticConfig(**config).build(request(path))


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, capture()) < 0.01
    assert data.scene.points.shape == (20, 3)
    assert float(data.scene.point_colors.mean()) == 0.25


def test_the_cameras_of_the_test_file_are_held_out(tmp_path):
    data = build(write(tmp_path))
    assert data.views(Split.EVAL).names == tuple(name(2, time) for time in range(TIMES))
    assert len(data.views(Split.TRAIN)) == 9
    assert data.views(Split.EVAL).times == (0.0, 0.5, 1.0)
    assert data.scene.time_range == pytest.approx((0.0, 2 / 30))
    assert data.notes() == (
        f"{tmp_path}/train_meta.json: 3 cameras at 3 times",
        f"{tmp_path}/test_meta.json: 1 cameras at 3 times",
        "3 times, 30 per second (the default; datamanager.fps=N sets another)",
        f"{tmp_path}/init_pt_cld.npz: 20 points",
        "per-view map segmentation: 1 channel, resampled by nearest",
        "held-out views: the data set's own split, test_meta.json",
    )


def test_cameras_are_numbered_over_both_files(tmp_path):
    data = build(write(tmp_path))
    numbers = {
        split: {int(camera.camera_index[0]) for camera in data.views(split).cameras}
        for split in Split
    }
    assert numbers == {Split.TRAIN: {0, 1, 3}, Split.EVAL: {2}}


def test_other_cameras_are_held_out_by_their_number(tmp_path):
    data = build(write(tmp_path), eval_cameras=("10", "13"))
    assert {view[:2] for view in data.views(Split.EVAL).names} == {"10", "13"}
    assert data.views(Split.EVAL).origin == "cameras 10, 13"
    with pytest.raises(DataError, match=r"datamanager\.eval_cameras=9: there is no camera of this"):
        build(tmp_path, eval_cameras=("9",))


def test_segmentation_says_what_moves(tmp_path):
    mask = build(write(tmp_path)).moving_mask(Split.TRAIN, 4)
    assert mask.shape == (HEIGHT, WIDTH, 1)
    assert bool(mask[:20, :30].all())
    assert int(mask.sum()) == 600


def test_times_are_chosen(tmp_path):
    data = build(write(tmp_path), first=1, fps=2.0)
    assert data.scene.time_range == (0.5, 1.0)
    assert len(data.views(Split.EVAL)) == 2


def test_a_file_of_the_set_stands_for_its_folder(tmp_path):
    path = write(tmp_path) / "train_meta.json"
    assert PanopticConfig.detect(path).recognised
    assert len(build(path).views(Split.EVAL)) == TIMES
    assert not PanopticConfig.detect(tmp_path / "ims").recognised


def test_images_that_are_not_on_disk_are_left_out(tmp_path):
    write(tmp_path)
    (tmp_path / "ims" / name(0, 1)).unlink()
    assert "1 of 12 images are not on disk and are left out: 10/000001.jpg" in (
        build(tmp_path).notes()
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"k": None}, r"its lists k, w2c, fn, cam_id are missing, empty or of different lengths"),
        ({"fn": [["a"]] * TIMES}, r"are missing, empty or of different lengths"),
        ({"w": np.inf}, r"train_meta\.json: 10/000000\.jpg: w: expected one finite number"),
        ({"cam_id": [[10, "left", 13]] * TIMES}, r"cam_id: expected whole numbers, found 'left'\."),
        ({"cam_id": [[10, 11.5, 13]] * TIMES}, r"cam_id: expected whole numbers, found 11\.5\."),
        ({"w": "wide"}, r"train_meta\.json: 10/000000\.jpg: w: expected one finite number"),
        ({"w2c": [[[[1.0]]] * 3] * TIMES}, r"w2c: expected 3 x 4 or 4 x 4 finite numbers, found"),
        ({"w2c": [[np.diag([2.0, 1, 1, 1]).tolist()] * 3] * TIMES}, r"the pose is not rigid"),
        ({"w": WIDTH + 8}, r"is 64x48 pixels, but .* describes 72x48"),
    ],
)
def test_damaged_settings_are_refused(tmp_path, settings, message):
    with pytest.raises(DataError, match=message):
        build(write(tmp_path, ("train_meta.json",), **settings))


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    file = write(tmp_path) / "test_meta.json"
    file.write_text(file.read_text()[:200])
    with pytest.raises(DataError, match=r"test_meta\.json cannot be read as JSON"):
        build(tmp_path)


def test_a_point_cloud_that_is_none_is_refused(tmp_path):
    (write(tmp_path) / "init_pt_cld.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(DataError, match=r"init_pt_cld\.npz does not hold points"):
        build(tmp_path)
    np.savez(tmp_path / "init_pt_cld.npz", data=np.zeros((4, 3)))
    with pytest.raises(DataError, match=r"its data has the shape \[4, 3\]"):
        build(tmp_path)


def test_images_decode(tmp_path):
    (batch,) = build(write(tmp_path)).load(Split.EVAL, [1], torch.device("cpu"))
    assert batch.images.shape == (1, HEIGHT, WIDTH, 3)


def test_segmentation_is_a_map_of_every_view_if_all_have_it(tmp_path):
    data = build(write(tmp_path))
    assert data.views(Split.TRAIN).maps == data.views(Split.EVAL).maps == {"segmentation": 1}
    (batch,) = data.load(Split.EVAL, [1], torch.device("cpu"))
    values = batch.maps["segmentation"].values
    assert values.shape == (1, HEIGHT, WIDTH, 1)
    assert values.unique().tolist() == [0.0, 255.0]
    assert build(tmp_path, segmentation=False).views(Split.TRAIN).maps == {}
    (tmp_path / "seg" / name(0, 1)).with_suffix(".png").unlink()
    assert build(tmp_path).views(Split.TRAIN).maps == {}
