"""The views of the built-in scene: their images repeat, and its settings are checked."""

from pathlib import Path

import pytest
import torch
from support.built_in_scene import CPU, HERE, images, small

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import ConfigError
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.datamanagers.synthetic.raycast import photograph, project, rays
from gsfw.datamanagers.synthetic.scene import SyntheticScene, solids


def test_scene_points_lie_where_the_training_views_saw_them(static):
    # The views are in the scene frame and float32: what a method is given fits together.
    scene, world = SyntheticScene(solids(0), 0.0), static.scene.world_from_scene
    points = static.scene.points
    in_world = world.apply(points).T
    visible = torch.zeros(len(points), dtype=torch.bool)
    for camera in static.views(Split.TRAIN).cameras:
        pixels = project(camera, points.T.double())
        in_image = ((pixels > 0) & (pixels < torch.tensor([[32.0], [24.0]]))).all(dim=0)
        moved = Cameras(
            world.camera(camera.world_to_camera), camera.intrinsics, camera.width, camera.height
        )
        origins, directions = rays(moved, pixels)
        hits = scene.trace(origins, directions)
        near = (hits.points - in_world).norm(dim=0) < 0.01
        error = (project(moved, hits.points) - pixels).norm(dim=0)
        assert float(error[near].max()) <= 0.01
        visible |= near & in_image
    assert bool(visible.all())


def test_a_held_out_image_shows_what_single_rays_see(static):
    (batch,) = static.load(Split.EVAL, [1], CPU)
    camera, scene = static.views(Split.EVAL).cameras[1], SyntheticScene(solids(0), 0.0)
    world = static.scene.world_from_scene
    moved = Cameras(world.camera(camera.world_to_camera), camera.intrinsics, 32, 24)
    y, x = torch.meshgrid(torch.arange(24) + 0.5, torch.arange(32) + 0.5, indexing="ij")
    origins, directions = rays(moved, torch.stack([x, y]).view(2, -1))
    hits = scene.trace(origins, directions)
    colors = scene.shade(hits, directions).T.view(24, 32, 3)
    alpha = (hits.solid >= 0).view(24, 32, 1)
    whole = (batch.alpha[0] == 1) & alpha
    assert float((batch.images[0] - colors).abs()[whole[..., 0]].median()) < 0.03
    assert float((batch.alpha[0] - alpha.float()).abs().mean()) < 0.03


def test_views_have_their_own_names_and_places(static):
    train, held = static.views(Split.TRAIN), static.views(Split.EVAL)
    assert train.names[0] == "train_000"
    assert held.names == ("eval_000", "eval_001")
    assert train.times is None
    full = SyntheticConfig(points=0, width=1, height=1).build(HERE)
    places = [torch.cat([c.centers for c in full.views(split).cameras]) for split in Split]
    assert float(torch.cdist(*places).min()) > 0.09


def test_the_scene_frame_has_extent_one_and_leads_back_to_the_world(static):
    scene = static.scene
    assert scene.extent == 1.0
    assert scene.has_alpha
    assert scene.up == "z"
    assert not scene.is_dynamic
    world = scene.world_from_scene.apply(scene.points)
    assert float(world[:, 2].min()) > -0.11
    assert float(world[:, :2].norm(dim=1).max()) < 1.51


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_and_another_does_not(static):
    again, other = small().build(HERE), small(seed=1).build(HERE)
    assert torch.equal(images(static), images(again))
    assert torch.equal(static.scene.points, again.scene.points)
    assert torch.equal(static.scene.point_colors, again.scene.point_colors)
    assert not torch.equal(images(static), images(other))
    assert not torch.equal(static.scene.points, other.scene.points)


def test_images_are_cast_only_when_they_are_asked_for(monkeypatch):
    cast = []

    def counted(scene, camera):
        cast.append(camera)
        return photograph(scene, camera)

    monkeypatch.setattr("gsfw.datamanagers.synthetic.data.photograph", counted)
    data = small().build(HERE)
    assert cast == []
    for _ in range(2):
        data.load(Split.TRAIN, [3], CPU)
    assert len(cast) == 1


def test_the_bits_of_an_image_do_not_depend_on_threads_or_on_the_order_of_views(static):
    threads = torch.get_num_threads()
    other = small().build(HERE)
    other.prefetch(Split.EVAL, [1])
    torch.set_num_threads(threads + 1)
    try:
        backwards = [other.load(Split.TRAIN, [index], CPU)[0].images for index in (5, 4, 3)]
    finally:
        torch.set_num_threads(threads)
    expected = [static.load(Split.TRAIN, [index], CPU)[0].images for index in (5, 4, 3)]
    assert all(torch.equal(*pair) for pair in zip(backwards, expected, strict=True))


def test_downscaling_shrinks_images_by_area_and_intrinsics_exactly():
    full = small(width=64, height=50, points=0).build(HERE)
    half = small(width=64, height=50, points=0).build(DataRequest(None, downscale=2.0))
    camera = half.views(Split.TRAIN).cameras[0]
    assert (camera.width, camera.height) == (32, 25)
    assert torch.allclose(
        camera.intrinsics[0, :2] * 2, full.views(Split.TRAIN).cameras[0].intrinsics[0, :2]
    )
    white = torch.ones(3)
    (large,), (little,) = full.load(Split.TRAIN, [0], CPU), half.load(Split.TRAIN, [0], CPU)
    averaged = large.target(white).view(25, 2, 32, 2, 3).mean(dim=(1, 3))
    assert float((averaged - little.target(white)[0]).abs().mean()) < 0.005


def test_at_time_zero_the_moving_scene_is_the_static_one(static, moving):
    assert moving.views(Split.TRAIN).times[0] == 0
    first, static_first = (
        moving.load(Split.TRAIN, [0], CPU)[0],
        static.load(Split.TRAIN, [0], CPU)[0],
    )
    assert torch.equal(first.images, static_first.images)
    assert torch.equal(first.alpha, static_first.alpha)
    assert not torch.equal(images(moving)[5], images(static)[5])


def test_every_time_of_the_moving_scene_is_seen_by_some_cameras(moving):
    assert moving.views(Split.TRAIN).times == (0.0, 0.0, 0.5, 0.5, 1.0, 1.0)
    assert set(moving.views(Split.EVAL).times) <= {0.0, 0.5, 1.0}
    scene = moving.scene
    assert scene.is_dynamic
    assert (scene.num_times, scene.time_range) == (3, (0.0, 1.0))
    assert set(scene.point_times.tolist()) == {0.0, 0.5, 1.0}
    batches = moving.load(Split.TRAIN, [0, 1, 2], CPU)
    assert [batch.views for batch in batches] == [(0, 1), (2,)]
    assert [float(batch.time) for batch in batches] == [0.0, 0.5]


def test_nothing_on_disk_is_taken_for_the_built_in_scene(tmp_path):
    found = SyntheticConfig.detect(tmp_path)
    assert not found.recognised
    assert found.looked_for == ""


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"moving": True, "times": 7},
            "datamanager.views=6 cannot show datamanager.times=7.\n"
            "Each time needs a view of its own: ask for more views, or for fewer times.",
        ),
        (
            {"width": 40_000, "height": 20_000},
            "the built-in scene would take 25600 MB, but cache_mb=2048.\n"
            "Give cache_mb=25600 or more, or ask for fewer or smaller images.",
        ),
    ],
)
def test_settings_that_cannot_be_met_are_refused(changes, message):
    with pytest.raises(ConfigError) as caught:
        small(**changes).build(HERE)
    assert str(caught.value) == message


def test_a_scene_that_takes_less_than_a_megabyte_is_refused_with_the_memory_that_it_needs():
    with pytest.raises(ConfigError) as caught:
        small().build(DataRequest(None, cache_megabytes=0))
    assert str(caught.value) == (
        "the built-in scene would take 1 MB, but cache_mb=0.\n"
        "Give cache_mb=1 or more, or ask for fewer or smaller images."
    )


def test_data_given_to_the_built_in_scene_is_refused():
    with pytest.raises(ConfigError) as caught:
        small().build(DataRequest(Path("somewhere")))
    assert str(caught.value) == (
        "datamanager=synthetic is built in and reads no data, but data=somewhere.\n"
        "Leave out data, or leave out datamanager to have the format recognised."
    )
