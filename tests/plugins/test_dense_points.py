"""init=dense: the chosen views, the points, and what runs start from without them."""

from dataclasses import replace

import pytest
import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataRequest, Split, Views, WrappedDataManager
from gsfw.core.operators import Operators
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.kernels.cpu.native_module import native
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.dense_points import (
    MOST_VIEWS,
    Start,
    chosen_views,
    dense_count,
    dense_downscale,
    dense_start,
    dense_surface,
    views_of_places,
)
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve

WHITE = torch.ones(3)
OPERATORS = Operators() if native() is None else CpuOperators()


def views_at(times: list[float | None], model: CameraModel = CameraModel.PINHOLE) -> Views:
    cameras = tuple(
        Cameras(
            torch.eye(4)[None],
            torch.eye(3)[None],
            8,
            6,
            model,
            None if time is None else torch.tensor([time]),
        )
        for time in times
    )
    return Views(tuple(str(i) for i in range(len(times))), cameras)


def started(data, background: torch.Tensor | None, most: int) -> Start:
    return dense_start(data.scene, dense_surface(data, background, OPERATORS), most)


class Changed(WrappedDataManager):
    """A capture with other cameras or points."""

    def __init__(self, given, views=None, scene=None):
        super().__init__(given)
        self._views, self._scene = views or given.views(Split.TRAIN), scene or given.scene

    @property
    def scene(self):
        return self._scene

    def views(self, split):
        return self._views


@pytest.fixture(scope="module")
def data():
    return SyntheticConfig(width=64, height=48, views=8).build(DataRequest(None))


def pointless(data) -> Changed:
    none = torch.empty(0, 3)
    return Changed(data, scene=replace(data.scene, points=none, point_colors=none))


def test_a_fixed_camera_has_one_view_where_any_time_will_do():
    """By time first, as films of several cameras are listed: every tenth view is of one camera."""
    times = [number // 10 / 149 for number in range(1500)]
    views = views_at(times)
    cameras = [
        replace(camera, world_to_camera=torch.eye(4)[None] * 1.0) for camera in views.cameras
    ]
    for number, camera in enumerate(cameras):
        camera.world_to_camera[0, 0, 3] = float(number % 10)
    assert views_of_places(replace(views, cameras=tuple(cameras))) == list(range(10))


def test_the_first_time_with_the_most_cameras_is_taken():
    assert chosen_views(views_at([0.0, 0.5, 0.5, 1.0, 1.0])) == [1, 2]


def test_a_static_capture_gives_all_views_up_to_a_limit():
    assert chosen_views(views_at([None] * 5)) == [0, 1, 2, 3, 4]
    assert len(chosen_views(views_at([None] * 1000))) <= MOST_VIEWS


def test_views_of_other_lenses_are_left_out():
    assert chosen_views(views_at([None] * 3, CameraModel.FISHEYE)) == []


@pytest.mark.parametrize("with_points", [True, False])
def test_points_of_the_built_in_scene_lie_on_its_surfaces(data, with_points: bool):
    given = data if with_points else pointless(data)
    start = started(given, WHITE, 0)
    points = start.scene.points
    assert len(points) >= 100
    assert start.scene.point_times is None
    median = torch.cdist(points, data.scene.points).amin(1).median()
    assert median < 0.008 * data.scene.extent
    assert "surface points found in the images (init=dense)" in start.notes[0]


def test_points_are_no_more_than_asked_for(data):
    start = started(data, WHITE, 120)
    assert len(start.scene.points) == len(start.scene.point_colors) == 120


def test_the_number_of_points_follows_the_pixels_of_a_view():
    assert dense_count(57_600) == 28_800
    assert dense_count(1) == 1
    assert dense_count(0) == 0


def test_one_camera_per_time_starts_from_what_the_data_brings(data):
    views = data.views(Split.TRAIN)
    single = replace(views, names=views.names[:1], cameras=views.cameras[:1])
    start = started(Changed(data, single), None, 0)
    assert start.scene is data.scene
    assert start.notes == (
        "init=dense: 'synthetic' has 1 pinhole cameras at one time, not two; starting from the "
        f"{len(data.scene.points):,} points of the data.",
    )


def test_cameras_in_one_place_start_from_what_the_data_brings(data):
    views = data.views(Split.TRAIN)
    pose = views.cameras[0].world_to_camera
    still = tuple(replace(camera, world_to_camera=pose) for camera in views.cameras)
    start = started(Changed(data, replace(views, cameras=still)), None, 0)
    assert start.scene is data.scene
    assert "agree on 0% of" in start.notes[0]


def test_wrong_poses_start_at_random_where_there_are_no_points(data):
    views = data.views(Split.TRAIN)
    order = [3, 6, 1, 4, 7, 2, 5, 0]
    mixed = tuple(
        replace(camera, world_to_camera=views.cameras[other].world_to_camera)
        for camera, other in zip(views.cameras, order, strict=True)
    )
    given = Changed(pointless(data), replace(views, cameras=mixed), pointless(data).scene)
    start = started(given, None, 0)
    assert len(start.scene.points) == 0
    assert start.notes[0].endswith("starting from random splats.")


def composed(**given: str) -> Composition:
    given |= {"method": "3dgs", "steps": "2", "datamanager.views": "5"}
    given = {name.replace("__", "."): value for name, value in given.items()}
    registry = installed()
    return compose(resolve(registry, [Layer("command line", given)]), registry)


def test_a_run_on_small_images_starts_from_points_of_larger_ones():
    size = {"datamanager__width": "96", "datamanager__height": "72"}
    run = composed(init="dense", downscale="3", **size)
    assert run.parts.model.num_rows == 32 * 24 // 2
    assert any("surface points" in note for note in run.notes())


def test_a_run_has_no_more_points_than_its_budget_or_than_it_asks_for():
    size = {"datamanager__width": "48", "datamanager__height": "36"}
    assert composed(init="dense", strategy__budget="200", **size).parts.model.num_rows == 200
    assert composed(init="dense", dense_points="150", **size).parts.model.num_rows == 150


def test_the_old_name_starts_from_dense_points():
    size = {"datamanager__width": "48", "datamanager__height": "36"}
    run = composed(init="stereo", **size)
    assert run.settings.config.init == "dense"
    assert "init=stereo was renamed to init=dense." in run.notes()


@pytest.mark.slow
def test_images_for_stereo_are_the_same_whatever_the_size_of_training(monkeypatch):
    monkeypatch.setattr("gsfw.plugins.dense_points.VIEW_PIXELS", 100)
    sizes = []

    def surface(images, background, operators):
        sizes.append(images.views(Split.TRAIN).cameras[0].width)
        return "nothing is looked for"

    monkeypatch.setattr("gsfw.plugins.start.dense_surface", surface)
    # Shrunk images have whole pixels: 5 times 12 x 9 and 8 times 7 x 5 are not 58 x 43.
    for divisor in ("1", "3", "5", "8"):
        size = {"datamanager__width": "58", "datamanager__height": "43"}
        composed(init="dense", downscale=divisor, **size)
    assert len(sizes) == 4
    assert len(set(sizes)) == 1


def test_small_images_are_not_shrunk_for_stereo():
    assert dense_downscale(SyntheticConfig(width=50, height=40).build(DataRequest(None))) == 1
    assert dense_downscale(SyntheticConfig(width=400, height=300).build(DataRequest(None))) == 2.5


def test_a_surface_that_was_found_for_one_image_size_serves_another(monkeypatch):
    size = {"datamanager__width": "96", "datamanager__height": "72"}
    first = composed(init="dense", **size)
    monkeypatch.setattr("gsfw.plugins.start.dense_surface", None)  # It is not called.
    registry = installed()
    small = replace(first.settings, config=replace(first.settings.config, downscale=2.0))
    again = compose(small, registry, found=first.found)
    assert again.parts.model.num_rows == 48 * 36 // 2
