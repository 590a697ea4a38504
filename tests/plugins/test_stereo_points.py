"""init=stereo: the chosen views, the points, and the refusals."""

from dataclasses import replace

import pytest
import torch

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataRequest, Split, Views
from gsfw.core.errors import ConfigError
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve
from gsfw.plugins.stereo_points import (
    MOST_VIEWS,
    POINTS_PER_PIXEL,
    chosen_views,
    stereo_downscale,
    with_stereo_points,
)

WHITE = (1.0, 1.0, 1.0)


def views_at(times: list[float | None]) -> Views:
    cameras = tuple(
        Cameras(
            torch.eye(4)[None],
            torch.eye(3)[None],
            8,
            6,
            time=None if time is None else torch.tensor([time]),
        )
        for time in times
    )
    return Views(tuple(str(i) for i in range(len(times))), cameras)


def test_the_first_time_with_the_most_cameras_is_taken():
    assert chosen_views(views_at([0.0, 0.5, 0.5, 1.0, 1.0])) == [1, 2]


def test_a_static_capture_gives_all_views_up_to_a_limit():
    assert chosen_views(views_at([None] * 5)) == [0, 1, 2, 3, 4]
    assert len(chosen_views(views_at([None] * 200))) <= MOST_VIEWS


def test_one_camera_per_time_is_refused():
    data = SyntheticConfig(moving=True, width=24, height=18).build(DataRequest(None))
    views = data.views(Split.TRAIN)
    single = replace(views, names=views.names[:1], cameras=views.cameras[:1])
    data.views = lambda split: single
    with pytest.raises(ConfigError, match=r"init=stereo: .* has 1 cameras at one time"):
        with_stereo_points(data, WHITE, 0)


def test_points_of_the_built_in_scene_lie_in_front_of_its_cameras():
    data = SyntheticConfig(width=64, height=48, views=8).build(DataRequest(None))
    scene = with_stereo_points(data, WHITE, 0)
    assert len(scene.points) >= 100
    assert scene.point_times is None
    truth = data.scene.points
    median = torch.cdist(scene.points, truth).amin(1).median()
    assert median < 0.008 * scene.extent, "0.009 before semi-global matching, 0.006 with it"


def test_points_are_limited_by_the_pixels_of_a_view():
    data = SyntheticConfig(width=40, height=30, views=5).build(DataRequest(None))
    scene = with_stereo_points(data, WHITE, 50)
    assert len(scene.points) == len(scene.point_colors) == POINTS_PER_PIXEL * 50


def test_a_run_on_small_images_starts_from_points_of_larger_ones():
    given = {"method": "3dgs", "init": "stereo", "downscale": "2", "steps": "2"}
    given |= {"datamanager.width": "60", "datamanager.height": "45", "datamanager.views": "5"}
    layer = Layer("test", given)
    registry = installed()
    model = compose(resolve(registry, [layer]), registry).parts.model
    own = SyntheticConfig(width=60, height=45, views=5).build(DataRequest(None, downscale=2))
    small = with_stereo_points(own, WHITE, 30 * 22)
    assert len(small.points) < model.num_rows <= POINTS_PER_PIXEL * 30 * 22


def test_small_images_are_read_again_at_a_larger_size_for_stereo():
    data = SyntheticConfig(width=50, height=40).build(DataRequest(None))
    assert stereo_downscale(data, 8.0) == 2.0
    assert stereo_downscale(data, 2.0) == 1.0
    large = SyntheticConfig(width=400, height=300).build(DataRequest(None))
    assert stereo_downscale(large, 4.0) == 4.0
