"""The formats on real captures, which are beside the checkout or not at all."""

import numpy as np
import pytest
import torch

from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.blender import BlenderConfig
from gsfw.datamanagers.colmap.config import ColmapConfig

CPU = torch.device("cpu")


@pytest.mark.slow
def test_fox_is_seen_as_colmap_sees_it(shared_data):
    pycolmap = pytest.importorskip("pycolmap")
    data = ColmapConfig().build(DataRequest(shared_data / "captures/fox"))
    assert (len(data.views(Split.TRAIN)), len(data.views(Split.EVAL))) == (43, 7)
    assert data.scene.points.shape == (12_169, 3)
    assert data.scene.name == "fox"
    model = pycolmap.Reconstruction(str(shared_data / "captures/fox/sparse/0"))
    to_scene = data.scene.world_from_scene.inverse()
    views = data.views(Split.TRAIN)
    cameras = dict(zip(views.names, views.cameras, strict=True))
    for image in model.images.values():
        if image.name not in cameras:
            continue
        seen = [model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()][::20]
        wanted = np.array([image.project_point(point) for point in seen])
        pose = cameras[image.name].world_to_camera[0]
        points = to_scene.apply(torch.tensor(np.array(seen))).float()
        local = points @ pose[:3, :3].T + pose[:3, 3]
        pixels = (local @ cameras[image.name].intrinsics[0].T)[:, :2] / local[:, 2:]
        assert np.abs(pixels.numpy() - wanted).max() < 0.01


def test_fox_loads_a_downscaled_image(shared_data):
    data = ColmapConfig().build(DataRequest(shared_data / "captures/fox", downscale=8.0))
    (batch,) = data.load(Split.TRAIN, [0], CPU)
    assert batch.images.shape == (1, 160, 90, 3)
    data.close()


@pytest.mark.slow
def test_plush_reads_the_same_from_text_and_binary(shared_data, tmp_path):
    source = shared_data / "captures/plush"
    (tmp_path / "sparse").mkdir()
    (tmp_path / "images").symlink_to(source / "images")
    for part in ("cameras", "images", "points3D"):
        (tmp_path / f"sparse/{part}.txt").symlink_to(source / f"sparse/0/{part}.txt")
    written, read = (ColmapConfig().build(DataRequest(path)) for path in (source, tmp_path))
    assert written.scene.points.shape == (25_784, 3)
    order = written.scene.points[:, 0].argsort(), read.scene.points[:, 0].argsort()
    torch.testing.assert_close(written.scene.points[order[0]], read.scene.points[order[1]])
    assert written.views(Split.EVAL).names == read.views(Split.EVAL).names
    for pair in zip(
        written.views(Split.TRAIN).cameras, read.views(Split.TRAIN).cameras, strict=True
    ):
        torch.testing.assert_close(pair[0].world_to_camera, pair[1].world_to_camera)


def test_the_truncated_model_is_refused(shared_data):
    with pytest.raises(
        DataError, match=r"images\.bin is cut off or damaged: its 2359296 bytes end"
    ):
        ColmapConfig().build(DataRequest(shared_data / "malformed/colmap_truncated"))


def test_chair_has_alpha_and_its_own_split(shared_data):
    data = BlenderConfig().build(DataRequest(shared_data / "synthetic/chair", downscale=4.0))
    assert (len(data.views(Split.TRAIN)), len(data.views(Split.EVAL))) == (100, 25)
    assert data.scene.has_alpha
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    assert batch.images.shape == (2, 100, 100, 3)
    assert 0.05 < float(batch.alpha.mean()) < 0.6
    data.close()


def test_garden_robot_has_24_times_of_10_cameras(shared_data):
    data = BlenderConfig().build(DataRequest(shared_data / "dynamic/garden_robot_mv"))
    assert (len(data.views(Split.TRAIN)), len(data.views(Split.EVAL))) == (216, 24)
    assert (data.scene.num_times, data.scene.time_range) == (24, (0.0, 1.0))
    assert data.scene.is_dynamic
    views = data.views(Split.TRAIN)
    groups = views.groups(range(len(views)))
    assert [len(group) for group in groups] == [9] * 24
    (batch,) = data.load(Split.TRAIN, groups[3], CPU)
    assert batch.images.shape == (9, 300, 400, 3)
    data.close()


def test_the_images_of_d_nerf_sets_have_a_time_over_all_splits(shared_data):
    data = BlenderConfig().build(DataRequest(shared_data / "dynamic/mujoco_collision"))
    times = data.views(Split.TRAIN).times
    assert min(times) >= 0
    assert max(times) <= 1
    assert data.scene.num_times == 150
