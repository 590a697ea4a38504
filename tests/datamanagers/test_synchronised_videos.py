"""The ``synchronised-videos`` format."""

import numpy as np
import pytest
import torch
from plyfile import PlyData, PlyElement
from support.captures.synchronised_videos import TIMES, write
from support.small_captures import FOCAL, HEIGHT, WIDTH, projection_error, request, write_image
from support.small_videos import cameras, over_time

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.detection import describe_unrecognised
from gsfw.datamanagers.synchronised_videos import SynchronisedVideosConfig
from gsfw.datamanagers.video_traits import VideoTraits

pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")


def build(path, **config):
    return SynchronisedVideosConfig(**config).build(request(path))


def expected(count=3):
    capture = cameras(count)
    names = [[f"{name}/{time:06d}" for time in range(TIMES)] for name in capture.names]
    return over_time(capture, names)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, expected()) < 0.01
    assert data.views(Split.EVAL).times == pytest.approx((0.0, 1 / 3, 2 / 3, 1.0))
    assert data.scene.time_range == pytest.approx((0.0, 3 / 30))
    assert data.notes() == (
        f"{tmp_path}/cameras.json: 3 cameras",
        "4 times, 30 per second (the videos')",
        "there are no points (datamanager.points=FILE.ply names them)",
        "held-out views: camera cam00, as papers do",
        data.notes()[-1],
    )
    assert data.notes()[-1].startswith("12 images of 3 videos: decoded once and kept in ")
    data.close()


def test_videos_show_the_points_where_cameras_see_them(tmp_path):
    """A soft spot is drawn around where the first point falls; its middle is measured."""

    def draw(pixels):
        def spot(number, width, height):
            columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
            distance = (columns - pixels[0, 0]) ** 2 + (rows - pixels[0, 1]) ** 2
            return np.repeat((255 * np.exp(-distance / 18))[..., None], 3, 2).astype(np.uint8)

        return spot

    data = build(write(tmp_path, draw=draw))
    views = data.views(Split.TRAIN)
    point = data.scene.world_from_scene.inverse().apply(torch.from_numpy(cameras().points[:1]))
    for index in (2, 5):
        (batch,) = data.load(Split.TRAIN, [index], torch.device("cpu"))
        bright = batch.images[0, :, :, 1].double() - 0.1
        bright = bright.clamp_min(0)
        middle = torch.stack(
            [
                (bright.sum(0) * (torch.arange(WIDTH) + 0.5)).sum(),
                (bright.sum(1) * (torch.arange(HEIGHT) + 0.5)).sum(),
            ]
        )
        pose = views.cameras[index].world_to_camera[0].double()
        seen = views.cameras[index].intrinsics[0].double() @ (pose[:3, :3] @ point[0] + pose[:3, 3])
        assert float((middle / bright.sum() - seen[:2] / seen[2]).abs().max()) < 0.1
    data.close()


def test_distorted_videos_are_undistorted(tmp_path):
    data = build(write(tmp_path, dist=[0.1, 0.0, 0.0, 0.0]))
    assert any("undistorted from OPENCV to PINHOLE" in note for note in data.notes())
    camera = data.views(Split.TRAIN).cameras[0]
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape[1:3] == (camera.height, camera.width)
    data.close()


def test_videos_between_black_bars_are_cut(tmp_path):
    def draw(_):
        def barred(number, width, height):
            pixels = np.full((height, width, 3), 120, np.uint8)
            pixels[:3] = pixels[45:] = 0
            return pixels

        return barred

    data = build(write(tmp_path, draw=draw, size=(56, 48)))
    camera = data.views(Split.TRAIN).cameras[0]
    assert (camera.width, camera.height) == (56, 42)
    assert float(camera.intrinsics[0, 0, 0]) == pytest.approx(FOCAL[0] * 56 / 64)
    (batch,) = data.load(Split.TRAIN, [1], torch.device("cpu"))
    assert float(batch.images.min()) > 0.4
    data.close()


def test_of_two_cameras_none_is_held_out(tmp_path):
    data = build(write(tmp_path, count=2))
    assert len(data.views(Split.EVAL)) == 0
    data.close()


def test_a_folder_of_images_per_camera_will_do(tmp_path):
    write(tmp_path)
    for name in cameras().names:
        for time in range(TIMES):
            write_image(tmp_path / f"frames/{name}/{time}.png")
    data = build(tmp_path, videos="frames", fps=10.0)
    assert data.scene.time_range == pytest.approx((0.0, 0.3))
    assert data.views(Split.EVAL).names[0] == "cam00/0.png"


def test_cameras_without_a_video_and_videos_without_a_camera_are_left_out(tmp_path):
    folder = write(tmp_path)
    (folder / "videos/cam01.mp4").rename(folder / "videos/other.mp4")
    data = build(folder)
    assert "left out because without a video: cam01" in data.notes()
    assert "left out because not in cameras.json: other" in data.notes()
    data.close()


def test_names_that_do_not_fit_are_refused(tmp_path):
    folder = write(tmp_path)
    for video in list((folder / "videos").iterdir()):
        video.rename(video.with_name(f"take_{video.name}"))
    with pytest.raises(
        DataError,
        match=r"has the name of a camera: cameras\.json has cam00, cam01, cam02, the videos are "
        r"take_cam00\.mp4, take_cam01\.mp4, take_cam02\.mp4\.",
    ):
        build(folder)


def test_points_are_read_where_they_are_named(tmp_path):
    points = np.array([(1.0, 2.0, 3.0)], dtype=[(axis, "f4") for axis in "xyz"])
    PlyData([PlyElement.describe(points, "vertex")]).write(tmp_path / "cloud.ply")
    data = build(write(tmp_path), points="cloud.ply")
    world = data.scene.world_from_scene.apply(data.scene.points.double())
    torch.testing.assert_close(world, torch.tensor([[1.0, 2.0, 3.0]], dtype=torch.float64))
    assert float(data.scene.point_colors.mean()) == 0.5
    data.close()
    with pytest.raises(DataError, match=r"no\.ply cannot be read: .*\n.*remove datamanager\.p"):
        build(tmp_path, points="no.ply")


def test_a_calibration_that_is_not_there_is_refused(tmp_path):
    write(tmp_path)
    with pytest.raises(DataError, match=r"datamanager\.calibration=a\.json: there is no file"):
        build(tmp_path, calibration="a.json")
    (tmp_path / "cameras.json").unlink()
    with pytest.raises(
        DataError, match=r"contains no calibration file; looked for cameras\*\.json"
    ):
        build(tmp_path)


def test_an_empty_video_is_refused(tmp_path):
    write(tmp_path)
    (tmp_path / "videos/cam02.mp4").write_bytes(b"")
    with pytest.raises(DataError, match=r"cam02\.mp4: the file is empty \(0 bytes\)"):
        build(tmp_path)


@pytest.mark.parametrize("where", ["", "videos"])
def test_the_format_is_told_by_names(tmp_path, where):
    found = SynchronisedVideosConfig.detect(write(tmp_path, where, count=2))
    assert (found.recognised, found.found) == (True, "cameras.json and cam00.mp4, cam01.mp4")
    (tmp_path / "cameras.json").unlink()
    assert not SynchronisedVideosConfig.detect(tmp_path).recognised
    assert not SynchronisedVideosConfig.detect(tmp_path / "nowhere").recognised
    assert describe_unrecognised(tmp_path / where).startswith("the video cam00.mp4")


def test_what_is_odd_about_a_video_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(VideoTraits, "notes", lambda traits: iter(["the video is odd"]))
    assert "cam01.mp4: the video is odd" in build(write(tmp_path)).notes()
