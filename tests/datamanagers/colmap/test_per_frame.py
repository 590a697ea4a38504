"""The ``colmap-per-frame`` format."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from support.captures.colmap_per_frame import TIMES, moved, write
from support.small_captures import projection_error, request

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.colmap.per_frame import ColmapPerFrameConfig


def build(path, **config):
    return ColmapPerFrameConfig(**config).build(request(path))


def whole(times=range(TIMES)):
    capture = moved(0)
    names = [f"colmap_{time}/{name}" for time in times for name in capture.names]
    return replace(capture, poses=capture.poses * len(times), names=names)


def test_points_fall_where_they_should(tmp_path):
    assert projection_error(build(write(tmp_path)), whole()) < 0.01


def test_points_come_with_their_times(tmp_path):
    scene = build(write(tmp_path)).scene
    assert scene.points.shape == (20 + 18 + 16, 3)
    assert scene.point_times.tolist() == [0.0] * 20 + [0.5] * 18 + [1.0] * 16
    world = scene.world_from_scene.apply(scene.points.double())
    torch.testing.assert_close(world[20:38], torch.from_numpy(moved(1).points), atol=1e-5, rtol=0)
    colors = torch.from_numpy(np.concatenate([moved(time).colors for time in range(TIMES)]))
    torch.testing.assert_close(scene.point_colors, colors.float() / 255)


def test_the_first_camera_is_held_out_at_all_times(tmp_path):
    data = build(write(tmp_path))
    assert data.views(Split.EVAL).names == tuple(f"colmap_{t}/cam00.png" for t in range(TIMES))
    assert data.notes() == (
        f"{tmp_path}: 4 cameras",
        "3 times, 30 per second (the default; datamanager.fps=N sets another)",
        "54 points of 3 times",
        "held-out views: camera cam00, as papers do",
    )
    data = build(tmp_path, eval_cameras=("cam02",))
    assert {name[-9:] for name in data.views(Split.EVAL).names} == {"cam02.png"}


def test_cameras_keep_their_number_over_time(tmp_path):
    views = build(write(tmp_path)).views(Split.TRAIN)
    assert [int(camera.camera_index[0]) for camera in views.cameras] == [1, 2, 3] * TIMES


def test_folders_are_ordered_by_number(tmp_path):
    data = build(write(tmp_path, (2, 9, 10)), fps=1.0)
    assert data.scene.time_range == (2.0, 10.0)
    assert data.views(Split.EVAL).times == (1.0, 0.0, 0.875)
    assert data.views(Split.EVAL).names == tuple(f"colmap_{t}/cam00.png" for t in (10, 2, 9))


def test_points_of_every_second_time_may_do(tmp_path):
    scene = build(write(tmp_path), points_every=2).scene
    assert sorted(set(scene.point_times.tolist())) == [0.0, 1.0]


def test_a_single_time_is_static(tmp_path):
    scene = build(write(tmp_path), frames=1).scene
    assert (scene.point_times, scene.num_times) == (None, 0)


def test_a_time_without_a_model_is_refused(tmp_path):
    (write(tmp_path) / "colmap_7").mkdir()
    with pytest.raises(DataError, match=r"colmap_7 contains no COLMAP model"):
        build(tmp_path)
    assert build(tmp_path, frames=3).scene.num_times == 3


def test_a_damaged_model_is_refused(tmp_path):
    file = write(tmp_path) / "colmap_1/sparse/0/points3D.bin"
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(DataError, match=r"colmap_1/sparse/0/points3D\.bin is cut off or damaged"):
        build(tmp_path)


def test_a_first_time_after_the_last_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"has 3 times, and datamanager\.first=5 is after them"):
        build(write(tmp_path), first=5)


def test_the_format_is_told_by_names(tmp_path):
    found = ColmapPerFrameConfig.detect(write(tmp_path))
    assert (found.recognised, found.found) == (True, "colmap_0 to colmap_2")
    assert not ColmapConfig.detect(tmp_path).recognised
    assert not ColmapPerFrameConfig.detect(tmp_path / "colmap_0").recognised
    with pytest.raises(DataError, match=r"contains no colmap_0, colmap_1"):
        build(tmp_path / "colmap_0")
