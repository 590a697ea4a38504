"""The ``blender`` format."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from support.captures.blender import dnerf, write
from support.small_captures import (
    FOCAL,
    HEIGHT,
    WIDTH,
    projection_error,
    request,
    ring,
    write_image,
    write_transforms,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.datamanagers.blender import BlenderConfig

CPU = torch.device("cpu")


def build(path, eval_split="test", **settings):
    return BlenderConfig(eval_split).build(request(path, **settings))


def named(splits=("train", "test")):
    """The ring under the names that the loader gives the views of ``write``."""
    owner = ["train/r_0", "train/r_1", "train/r_2", f"{splits[-1]}/r_3", "", ""]
    return replace(ring(6), names=owner)


def test_points_fall_where_they_should_in_both_splits(tmp_path):
    data = build(write(tmp_path))
    assert data.views(Split.TRAIN).names == ("train/r_0", "train/r_1", "train/r_2")
    assert data.views(Split.EVAL).names == ("test/r_3",)
    assert projection_error(data, named()) < 0.01


def test_the_split_of_the_files_is_used_whatever_would_be_held_out(tmp_path):
    data = build(write(tmp_path), eval_every_nth=2)
    assert data.views(Split.EVAL).names == ("test/r_3",)
    assert data.notes() == (
        f"{tmp_path}/transforms_train.json: 3 frames",
        f"{tmp_path}/transforms_test.json: 1 frames",
        "held-out views: the data set's own split",
    )


def test_val_is_held_out_only_when_asked_for(tmp_path):
    write(tmp_path, ("train", "test", "val"))
    assert build(tmp_path).views(Split.EVAL).names == ("test/r_3",)
    assert build(tmp_path, "val").views(Split.EVAL).names == ("val/r_4",)


def test_without_a_test_file_training_images_are_held_out(tmp_path):
    data = build(write(tmp_path, ("train",)), eval_every_nth=2)
    assert data.views(Split.EVAL).names == ("train/r_0", "train/r_2")
    assert "there is no transforms_test.json" in data.notes()


def test_alpha_comes_with_straight_colours(tmp_path):
    data = build(write(tmp_path))
    assert data.scene.has_alpha
    assert data.scene.points.shape == (0, 3)
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    values = torch.arange(WIDTH * HEIGHT * 4).mul(7).remainder(256).reshape(HEIGHT, WIDTH, 4) / 255
    torch.testing.assert_close(batch.images[1], values[..., :3])
    torch.testing.assert_close(batch.alpha[1], values[..., 3:])
    white = batch.target(torch.ones(3))[0]
    torch.testing.assert_close(white, values[..., :3] * values[..., 3:] + 1 - values[..., 3:])


def test_times_are_normalised_over_all_splits_even_unused_ones(tmp_path):
    write(tmp_path, ("train", "test", "val"), times=[1.0, 2.0, 2.0, 4.0, 5.0, 9.0])
    data = build(tmp_path)
    assert data.views(Split.TRAIN).times == (0.0, 0.25, 0.25)
    assert data.views(Split.EVAL).times == (0.75,)
    assert (data.scene.time_range, data.scene.num_times) == ((1.0, 5.0), 4)


def test_the_same_lens_in_both_files_is_one_camera(tmp_path):
    data = build(write(tmp_path))
    for split in Split:
        assert {int(camera.camera_index[0]) for camera in data.views(split).cameras} == {0}


def test_a_file_of_the_split_stands_for_its_folder(tmp_path):
    data = build(write(tmp_path) / "transforms_train.json")
    assert len(data.views(Split.EVAL)) == 1
    assert data.scene.name == tmp_path.name


def test_the_angle_refers_to_the_width_of_the_image(tmp_path):
    write_image(tmp_path / "a.png", 20, 10)
    part = replace(ring(1), names=["a"])
    settings = dict.fromkeys(("fl_x", "fl_y", "cx", "cy", "w", "h"))
    write_transforms(
        tmp_path / "transforms_train.json", part, **settings, camera_angle_x=torch.pi / 2
    )
    intrinsics = build(tmp_path).views(Split.TRAIN).cameras[0].intrinsics[0]
    torch.testing.assert_close(intrinsics, torch.tensor([[10.0, 0, 10], [0, 10, 5], [0, 0, 1]]))


def test_an_unknown_split_is_refused(tmp_path):
    with pytest.raises(ConfigError) as error:
        build(write(tmp_path), "tset")
    assert str(error.value) == "datamanager.eval_split=tset: expected test or val."


def test_a_folder_without_training_file_is_refused(tmp_path):
    write(tmp_path, ("test",))
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert str(error.value) == (
        f"{tmp_path} contains no transforms_train.json.\nGive the folder that contains it."
    )


def test_focal_lengths_are_those_of_the_file(tmp_path):
    intrinsics = build(write(tmp_path)).views(Split.TRAIN).cameras[0].intrinsics[0]
    assert (intrinsics[0, 0], intrinsics[1, 1]) == FOCAL


def test_every_view_of_dnerf_has_its_time_in_its_split(tmp_path):
    test, val = build(dnerf(tmp_path)), build(tmp_path, "val")
    assert test.views(Split.TRAIN).times == val.views(Split.TRAIN).times == (0.0, 0.5, 1.0)
    assert (test.views(Split.EVAL).times, val.views(Split.EVAL).times) == ((0.25,), (0.75,))
    assert test.scene.is_dynamic
    assert (test.scene.time_range, test.scene.num_times) == ((0.0, 1.0), 5)
    (batch,) = test.load(Split.EVAL, [0], CPU)
    assert float(batch.time) == 0.25
    assert test.views(Split.EVAL).origin == "the data set's own split"


def test_seconds_are_kept_beside_the_normalised_times(tmp_path):
    write(tmp_path, ("train", "test"), times=[2.0, 4.0, 12.0, 7.0, 0.0, 0.0])
    data = build(tmp_path)
    assert data.scene.time_range == (2.0, 12.0)
    assert data.views(Split.EVAL).times == (0.5,)


def test_a_rig_that_stands_still_has_a_camera_for_each_pose(tmp_path):
    moments = [(pose, time) for pose in (0, 1) for time in (0.0, 0.5, 1.0)]
    for split, members in (("train", moments), ("test", [(2, 0.0), (2, 1.0)])):
        part = replace(
            ring(3),
            poses=[ring(3).poses[pose] for pose, _ in members],
            names=[f"cam{pose:02d}/{time}.png" for pose, time in members],
        )
        for name in part.names:
            write_image(tmp_path / name)
        settings = [{"time": time} for _, time in members]
        write_transforms(tmp_path / f"transforms_{split}.json", part, settings)
    data = build(tmp_path)
    found = [
        (int(camera.camera_index[0]), float(camera.time[0]))
        for split in Split
        for camera in data.views(split).cameras
    ]
    assert found == [(pose, time) for pose, time in moments] + [(2, 0.0), (2, 1.0)]


def test_masks_of_what_moves_are_for_evaluation_only(tmp_path):
    dnerf(tmp_path, masks=True)
    values = np.zeros((HEIGHT, WIDTH), np.uint8)
    values[10, 20] = 1
    (tmp_path / "masks").mkdir()
    Image.fromarray(values).save(tmp_path / "masks" / "r_3.png")
    data = build(tmp_path)
    mask = data.moving_mask(Split.EVAL, 0)
    assert mask.nonzero().tolist() == [[10, 20, 0]]
    assert data.moving_mask(Split.TRAIN, 0) is None
    (batch,) = data.load(Split.EVAL, [0], CPU)
    assert batch.mask is None
    # A smaller pixel moves where any of the pixels beneath it does.
    small = build(tmp_path, downscale=2.0).moving_mask(Split.EVAL, 0)
    assert small.nonzero().tolist() == [[5, 10, 0]]


def test_a_mask_that_is_named_has_to_be_there_and_to_fit(tmp_path):
    dnerf(tmp_path, masks=True)
    with pytest.raises(DataError) as error:
        build(tmp_path)
    assert str(error.value) == (
        f"{tmp_path}/transforms_test.json: frame test/r_3: its mask masks/r_3 is not on disk.\n"
        "Put it there, or remove motion_mask_path to let evaluation detect what moves."
    )
    write_image(tmp_path / "masks" / "r_3.png", 5, 4)
    with pytest.raises(DataError) as error:
        build(tmp_path).moving_mask(Split.EVAL, 0)
    assert str(error.value).startswith(f"{tmp_path}/masks/r_3.png: the mask is 5x4 pixels, its ")


@pytest.mark.parametrize(
    ("name", "train", "held", "times", "cameras"),
    [
        ("robot", 100, 20, 120, 1),
        ("mujoco_collision", 108, 21, 150, 12),
        ("mujoco_deformation", 126, 27, 180, 12),
        ("mujoco_texture", 108, 21, 150, 12),
        ("garden_robot_mv", 216, 24, 24, 10),
    ],
)
def test_real_data_of_this_format_is_read(shared_data, name, train, held, times, cameras):
    data = build(shared_data / "dynamic" / name)
    assert (len(data.views(Split.TRAIN)), len(data.views(Split.EVAL))) == (train, held)
    assert data.scene.num_times == times
    assert data.scene.time_range == (0.0, 1.0)
    found = {int(c.camera_index[0]) for split in Split for c in data.views(split).cameras}
    assert len(found) == cameras
    for split in Split:
        assert all(0 <= time <= 1 for time in data.views(split).times)
