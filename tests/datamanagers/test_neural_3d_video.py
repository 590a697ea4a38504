"""The ``neural-3d-video`` format."""

import numpy as np
import pytest
import torch
from plyfile import PlyData, PlyElement
from support.captures.llff import centred, write_folders, write_poses, write_videos
from support.small_captures import FOCAL, HEIGHT, WIDTH, builder_of, projection_error
from support.small_videos import cameras, over_time, shade

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.neural_3d_video import Neural3DVideoConfig

CPU = torch.device("cpu")


build = builder_of(Neural3DVideoConfig)


def test_points_fall_where_they_should_in_videos(tmp_path):
    capture = cameras()
    data = build(write_videos(tmp_path, capture))
    names = [[f"{name}/{time:06d}" for time in range(6)] for name in capture.names]
    assert projection_error(data, centred(over_time(capture, names))) < 0.01
    assert data.views(Split.EVAL).names == tuple(names[0])
    assert data.views(Split.TRAIN).names == (*names[1], *names[2])
    data.close()


def test_images_of_videos_come_with_their_time_and_camera(tmp_path):
    data = build(write_videos(tmp_path, cameras()))
    assert data.scene.num_times == 6
    assert data.scene.time_range == pytest.approx((0.0, 5 / 30))
    for index in (7, 0, 11):
        (batch,) = data.load(Split.TRAIN, [index], CPU)
        assert float(batch.cameras.time[0]) == pytest.approx(index % 6 / 5)
        assert int(batch.cameras.camera_index[0]) == 1 + index // 6
        brightness = 255 * float(batch.images[0, HEIGHT // 2 :].mean())
        assert abs(brightness - (shade(index % 6) - 7.5)) < 3
    data.close()


def test_images_of_one_time_share_a_batch(tmp_path):
    data = build(write_videos(tmp_path, cameras()))
    (batch,) = data.load(Split.TRAIN, [2, 8], CPU)
    assert batch.images.shape == (2, HEIGHT, WIDTH, 3)
    data.close()


@pytest.mark.parametrize("inner", ["images", ""])
def test_folders_of_images_are_read_likewise(tmp_path, inner):
    capture = cameras()
    data = build(write_folders(tmp_path, capture, inner=inner))
    names = [[f"{name}/{time:04d}.png" for time in range(4)] for name in capture.names]
    assert projection_error(data, centred(over_time(capture, names))) < 0.01
    assert data.notes() == (
        f"{tmp_path}/poses_bounds.npy: 3 cameras",
        "4 times, 30 per second (the default; datamanager.fps=N sets another)",
        "there are no points (looked for points3D.ply, points3d.ply, points3D_downsample2.ply, "
        "points3D_downsample.ply)",
        "held-out views: camera cam00, as papers do",
    )


def test_first_frames_stride_and_fps_choose_times(tmp_path):
    path = write_folders(tmp_path, cameras(), times=12)
    data = build(path, {"first": 2, "frames": 3, "stride": 4, "fps": 10.0})
    assert [name[-8:-4] for name in data.views(Split.EVAL).names] == ["0002", "0006", "0010"]
    assert data.scene.time_range == pytest.approx((0.2, 1.0))
    assert "3 of 12 times (2 to 10, every 4. of them), 10 per second (datamanager.fps)" in (
        data.notes()
    )


def test_papers_use_300_times():
    assert Neural3DVideoConfig().frames == 300


def test_other_cameras_are_held_out_by_name(tmp_path):
    path = write_folders(tmp_path, cameras())
    data = build(path, {"eval_cameras": ("cam01",)})
    assert {name[:5] for name in data.views(Split.EVAL).names} == {"cam01"}
    assert data.views(Split.EVAL).origin == "camera cam01"
    data = build(path, {"eval_cameras": ("none",)})
    assert len(data.views(Split.EVAL)) == 0


def test_points_beside_the_poses_are_read(tmp_path):
    write_folders(tmp_path, cameras())
    points = np.array(
        [(0.0, 1.0, 2.0, 255, 0, 51), (3.0, 4.0, 5.0, 0, 0, 0)],
        dtype=[*((axis, "f4") for axis in "xyz"), *((c, "u1") for c in ("red", "green", "blue"))],
    )
    PlyData([PlyElement.describe(points, "vertex")]).write(tmp_path / "points3D.ply")
    scene = build(tmp_path).scene
    world = scene.world_from_scene.apply(scene.points.double())
    torch.testing.assert_close(world[1], torch.tensor([3.0, 4.0, 5.0], dtype=torch.float64))
    torch.testing.assert_close(scene.point_colors[0], torch.tensor([1.0, 0.0, 0.2]))


def test_a_smaller_video_is_that_of_the_poses_scaled(tmp_path):
    capture = cameras()
    write_videos(tmp_path, capture)
    write_poses(tmp_path, capture, (HEIGHT * 1.5, WIDTH * 1.5))
    data = build(tmp_path)
    assert "cam00.mp4 is 64x48, 96x72 scaled" in data.notes()
    fx = data.views(Split.TRAIN).cameras[0].intrinsics[0, 0, 0]
    assert float(fx) == pytest.approx(FOCAL[0] / 1.5)
    data.close()


def test_shorter_footage_shortens_all_of_it(tmp_path):
    write_folders(tmp_path, cameras())
    (tmp_path / "cam01/images/0003.png").unlink()
    data = build(tmp_path)
    assert data.scene.num_times == 3
    assert "camera cam01 has 3 images, others up to 4: the first 3 of each are used" in data.notes()


def test_a_row_too_many_is_refused(tmp_path):
    write_folders(tmp_path, cameras())
    write_poses(tmp_path, cameras(4))
    with pytest.raises(
        DataError,
        match=r"has 4 cameras, but there are 3 videos or folders of images: cam00, cam01, cam02",
    ):
        build(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "poses_bounds.npy cannot be read"),
        (b"\x93NUMPY\x01\x00", "poses_bounds.npy cannot be read"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, content, message):
    write_folders(tmp_path, cameras())
    (tmp_path / "poses_bounds.npy").write_bytes(content)
    with pytest.raises(DataError, match=message):
        build(tmp_path)


def test_another_shape_is_refused(tmp_path):
    write_folders(tmp_path, cameras())
    np.save(tmp_path / "poses_bounds.npy", np.zeros((3, 15)))
    with pytest.raises(DataError, match=r"holds numbers of the shape \[3, 15\]"):
        build(tmp_path)


def test_a_pose_that_is_none_is_refused(tmp_path):
    write_folders(tmp_path, cameras())
    table = np.load(tmp_path / "poses_bounds.npy")
    table[1, 0] += 0.5
    np.save(tmp_path / "poses_bounds.npy", table)
    with pytest.raises(DataError, match=r"row 1 \(cam01\): the pose is not rigid"):
        build(tmp_path)


def test_the_format_is_told_by_names(tmp_path):
    assert not Neural3DVideoConfig.detect(write_poses(tmp_path, cameras())).recognised
    write_folders(tmp_path, cameras())
    found = Neural3DVideoConfig.detect(tmp_path)
    assert (found.recognised, found.found) == (True, "poses_bounds.npy and cam00, cam01, cam02")
    assert len(build(tmp_path / "poses_bounds.npy").views(Split.EVAL)) == 4
