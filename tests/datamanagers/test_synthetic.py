"""The built-in scene: its geometry is exact, its images repeat, its tracks are true."""

import math
from pathlib import Path

import pytest
import torch

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import ConfigError
from gsfw.datamanagers.synthetic import raycast
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.datamanagers.synthetic.dome import HELD_OUT, dome
from gsfw.datamanagers.synthetic.motion import Still
from gsfw.datamanagers.synthetic.raycast import SUBPIXELS, photograph, project, rays
from gsfw.datamanagers.synthetic.scene import LIGHT, Solid, SyntheticScene, solids
from gsfw.datamanagers.synthetic.shapes import Box, Cone, Cylinder, Sphere
from gsfw.datamanagers.synthetic.textures import Bands

CPU = torch.device("cpu")
HERE = DataRequest(None)


def small(**changes):
    settings = {"views": 6, "eval_views": 2, "width": 32, "height": 24, "points": 200, "times": 3}
    return SyntheticConfig(**(settings | changes))


@pytest.fixture(scope="module")
def static():
    return small().build(HERE)


@pytest.fixture(scope="module")
def moving():
    return small(moving=True).build(HERE)


def images(data, split=Split.TRAIN):
    batches = data.load(split, range(len(data.views(split))), CPU)
    return torch.cat([torch.cat([batch.images, batch.alpha], dim=-1) for batch in batches])


INSIDE = {
    Sphere: lambda p: p.norm(dim=0) - 1,
    Box: lambda p: p.abs().amax(dim=0) - 1,
    Cylinder: lambda p: torch.maximum(p[:2].norm(dim=0), p[2].abs()) - 1,
    Cone: lambda p: torch.maximum(p[:2].norm(dim=0) - (1 - p[2]) / 2, p[2].abs() - 1),
}
"""Functions that are negative inside each shape and 0 on its surface."""


@pytest.mark.parametrize("kind", INSIDE)
def test_rays_stop_where_they_first_enter_a_shape_and_normals_face_them(kind):
    generator = torch.Generator().manual_seed(0)
    origins = torch.randn(3, 4000, generator=generator, dtype=torch.float64)
    origins = origins / origins.norm(dim=0) * 3
    aims = torch.rand(3, 4000, generator=generator, dtype=torch.float64) * 3 - 1.5
    directions = aims - origins
    distances = kind().distances(origins, directions)
    steps = torch.linspace(0, 2, 801, dtype=torch.float64)
    along = origins[:, :, None] + directions[:, :, None] * steps
    inside = (INSIDE[kind](along.reshape(3, -1)) < 0).view(4000, -1)
    met = distances.isfinite()
    assert bool(met.any())
    assert bool((~met).any())
    assert not bool(inside[~met].any())
    before = steps < distances[met][:, None] - 1e-9
    assert not bool((inside[met] & before).any())
    points = origins[:, met] + distances[met] * directions[:, met]
    assert float(INSIDE[kind](points).abs().max()) < 1e-9
    assert float((kind().normals(points) * directions[:, met]).sum(dim=0).max()) <= 1e-9


def test_rays_leaving_a_surface_do_not_meet_it_again():
    directions = torch.tensor([[0.1], [0.0], [1.0]])
    for shape in (Sphere(), Box(), Cylinder(), Cone()):
        assert not bool(
            shape.distances(torch.tensor([[0.0], [0.0], [1.001]]), directions).isfinite()
        )


def test_a_ball_covers_the_disc_of_pixels_that_geometry_says():
    # Perspective makes a circle of radius f r / sqrt(d^2 - r^2) of a ball straight ahead.
    texture = Bands((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 1.0)
    scene = SyntheticScene(
        (Solid("ball", Sphere(), Still((0.0, 0.0, 5.0), (0.5, 0.5, 0.5)), texture),), 0.0
    )
    matrix = torch.tensor([[[200.0, 0, 41.3], [0, 200.0, 30.8], [0, 0, 1]]], dtype=torch.float64)
    camera = Cameras(torch.eye(4, dtype=torch.float64)[None], matrix, 80, 60)
    alpha = photograph(scene, camera)[..., 3].double() / 255
    radius = 200 * 0.5 / math.sqrt(5**2 - 0.5**2)
    assert float(alpha.sum()) == pytest.approx(math.pi * radius**2, rel=2e-3)
    x, y = torch.arange(80) + 0.5, torch.arange(60) + 0.5
    assert float((alpha * x).sum() / alpha.sum()) == pytest.approx(41.3, abs=0.01)
    assert float((alpha * y[:, None]).sum() / alpha.sum()) == pytest.approx(30.8, abs=0.01)


def test_known_surface_points_are_seen_where_the_camera_model_projects_them():
    scene = SyntheticScene(solids(0), 0.0)
    angles = torch.linspace(0, 2 * math.pi, 200, dtype=torch.float64)
    circle = torch.stack([angles.cos(), angles.sin(), torch.zeros_like(angles)])
    # The ball's equator, the column's upper rim, a circle painted on the table.
    known = {
        3: torch.tensor([[0.72], [0.48], [0.33]]) + 0.33 * circle,
        1: torch.tensor([[-0.05], [0.15], [1.04]]) + 0.2 * circle,
        0: 1.2 * circle,
    }
    seen = 0
    for camera in [dome(5, 0.0, 400, 300, 0).select([i]) for i in range(5)]:
        for solid, points in known.items():
            pixels = project(camera, points).float()
            origins, directions = rays(camera, pixels)
            hits = scene.trace(origins, directions)
            # Rays are float32, as for images; a grazing ray slides, so only near hits count.
            near = (hits.solid == solid) & ((hits.points - points).norm(dim=0) < 0.01)
            error = (project(camera, hits.points.double()) - project(camera, points)).norm(dim=0)
            assert float(error[near].max()) <= 0.01
            seen += int(near.sum())
    assert seen > 1000


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


@pytest.mark.parametrize("time", [0.0, 0.5, 1.0])
def test_an_image_cast_in_blocks_is_the_one_of_which_every_ray_tries_every_solid(time, monkeypatch):
    # Blocks try the solids near them only, and shadows the solids towards the sun only.
    monkeypatch.setattr(raycast, "TILE", 64)
    monkeypatch.setattr(raycast, "EDGE", -1.0)  # Edges everywhere.
    scene, steps = SyntheticScene(solids(2), time), SUBPIXELS
    for index in range(3):
        camera = dome(3, 0.0, 150, 60, 1).select([index])
        y, x = (torch.arange(side * steps) + 0.5 for side in (60, 150))
        grid = torch.meshgrid(y / steps, x / steps, indexing="ij")
        directions = rays(camera, torch.stack([grid[1], grid[0]]).view(2, -1))[1]
        origins = camera.centers.to(directions).T
        solid = scene.trace(origins, directions).solid.view(60, steps, 150, steps)
        covered = (solid >= 0).float().mean(dim=(1, 3))
        image = photograph(scene, camera)
        assert torch.equal(image[..., 3], (covered * 255).round().to(torch.uint8))
        assert 0 < float(covered.mean()) < 1


def test_one_sample_where_there_is_no_edge_changes_an_image_less_than_rounding(monkeypatch):
    def premultiplied():
        pixels = photograph(scene, camera).double() / 255
        return pixels[..., :3] * pixels[..., 3:]

    scene, camera = SyntheticScene(solids(0), 0.0), dome(3, 0.0, 160, 120, 1).select([1])
    few = premultiplied()
    monkeypatch.setattr(raycast, "EDGE", -1.0)
    error = (premultiplied() - few).square().mean()
    assert 0 < float(error) < 1 / (12 * 255**2)


def test_an_image_does_not_depend_on_the_strips_that_it_is_cast_in(monkeypatch):
    scene, camera = SyntheticScene(solids(0), 0.5), dome(3, 0.0, 80, 60, 1).select([0])
    whole = photograph(scene, camera)
    monkeypatch.setattr(raycast, "MAX_RAYS", 80 * 7)
    assert torch.equal(photograph(scene, camera), whole)


def test_shadows_fall_wherever_another_solid_hides_the_sun():
    # Against marching to the sun in small steps, from points all over the scene.
    scene = SyntheticScene(solids(0), 0.5)
    camera = dome(1, 0.0, 60, 45, 0)
    y, x = torch.meshgrid(torch.arange(45) + 0.5, torch.arange(60) + 0.5, indexing="ij")
    origin, directions = rays(camera, torch.stack([x, y]).view(2, -1).double())
    hits = scene.trace(origin, directions)
    table = hits.solid == 0
    points = hits.points[:, table]
    sun = torch.tensor(LIGHT, dtype=torch.float64)[:, None]
    hidden = torch.zeros(points.shape[1], dtype=torch.bool)
    for step in torch.linspace(0.005, 2.0, 400, dtype=torch.float64):
        for _, solid, pose in scene.placed[1:]:
            hidden |= INSIDE[type(solid.shape)](pose.to_own(points + step * sun)) < 0
    colors = scene.shade(hits, directions)[:, table]
    # Rays to the sun start a little above the surface, so a few next to a solid may differ.
    _, item, pose = scene.placed[0]
    own = pose.to_own(points)
    up = pose.normals_to_world(item.shape.normals(own))[2] > 0.99
    brightness = (colors / item.texture(own)).mean(dim=0)
    assert 20 < int((hidden & up).sum()) < int(up.sum()) - 20
    assert float((brightness[up & hidden] < 0.6).double().mean()) > 0.98
    assert float((brightness[up & ~hidden] > 0.9).double().mean()) > 0.98


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


def test_tracks_pass_through_every_point_at_its_time(moving):
    times = [0.0, 0.5, 1.0]
    tracks = moving.tracks(times)
    rows = (moving.scene.point_times * 2).long()
    columns = torch.arange(len(rows))
    error = (tracks.positions[rows, columns] - moving.scene.points).norm(dim=1)
    assert float(error.max()) < 1e-6
    assert bool(tracks.present[rows, columns].all())


def test_at_any_time_rays_meet_moved_points_where_their_tracks_say(moving):
    scene, world = SyntheticScene(solids(0), 0.5), moving.scene.world_from_scene
    tracks = moving.tracks([0.5])
    points = world.apply(tracks.positions[0][tracks.present[0]]).T
    met = torch.zeros(points.shape[1], dtype=torch.bool)
    for camera in [dome(8, 0.0, 400, 300, 0).select([i]) for i in range(8)]:
        hits = scene.trace(*rays(camera, project(camera, points)))
        met |= (hits.points - points).norm(dim=0) < 1e-5
    # What is not met lies in the shade of another solid, or faces the table.
    assert float(met.float().mean()) > 0.9


def test_solids_translate_rotate_deform_appear_and_vanish():
    poses = {solid.name: [solid.motion(time) for time in (0.0, 0.5, 1.0)] for solid in solids(0)}
    shift = {name: float((p[2].center - p[0].center).norm()) for name, p in poses.items()}
    change = {name: float((p[1].linear - p[0].linear).norm()) for name, p in poses.items()}
    assert shift["ball"] > 0.5
    assert change["ball"] == 0
    turned = poses["crate"][0].linear.inverse() @ poses["crate"][1].linear
    assert torch.allclose(turned @ turned.T, torch.eye(3, dtype=torch.float64))
    assert change["crate"] > 0.1
    squashed = [float(pose.linear.det()) for pose in poses["drop"]]
    assert squashed == pytest.approx([squashed[0]] * 3)
    assert change["drop"] > 0.1
    assert shift["table"] == change["table"] == shift["column"] == change["column"] == 0
    there = {time: {s.name for s in solids(0) if s.is_present(time)} for time in (0.0, 0.5, 1.0)}
    assert "cone" not in there[0.0]
    assert {"cone", "pebble"} <= there[0.5]
    assert "pebble" not in there[1.0]


def test_drops_foot_stays_on_the_table_while_it_is_deformed():
    (drop,) = (solid for solid in solids(0) if solid.name == "drop")
    foot = torch.tensor([[0.0], [0.0], [-1.0]], dtype=torch.float64)
    expected = drop.motion(0.0).to_world(foot)
    for time in (0.3, 0.5, 1.0):
        assert torch.allclose(drop.motion(time).to_world(foot), expected)


def test_nothing_on_disk_is_taken_for_the_built_in_scene(tmp_path):
    found = SyntheticConfig.detect(tmp_path)
    assert not found.recognised
    assert found.looked_for == ""


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"views": 1}, "datamanager.views=1: expected at least 2."),
        ({"width": 0}, "datamanager.width=0: expected at least 1."),
        (
            {"moving": True, "times": 7},
            "datamanager.views=6 cannot show datamanager.times=7.\n"
            "Each time needs a view of its own: ask for more views, or for fewer times.",
        ),
        (
            {"width": 40_000, "height": 20_000},
            "the built-in scene would take 25600 MB, but cache_mb=2048.\n"
            "Raise cache_mb, or ask for fewer or smaller images.",
        ),
    ],
)
def test_settings_that_cannot_be_met_are_refused(changes, message):
    with pytest.raises(ConfigError) as caught:
        small(**changes).build(HERE)
    assert str(caught.value) == message


def test_data_given_to_the_built_in_scene_is_refused():
    with pytest.raises(ConfigError) as caught:
        small().build(DataRequest(Path("somewhere")))
    assert str(caught.value) == (
        "datamanager=synthetic is built in and reads no data, but data=somewhere.\n"
        "Leave out data, or leave out datamanager to have the format recognised."
    )


def test_the_moving_mask_holds_all_that_moving_solids_ever_cover(moving, static):
    assert static.moving_mask(Split.EVAL, 0) is None
    camera = dome(2, HELD_OUT, 32, 24, 0).select([1])
    over_time = [photograph(SyntheticScene(solids(0), time), camera) for time in (0.0, 0.5, 1.0)]
    alpha = torch.stack(over_time)[..., 3].int()
    mask = moving.moving_mask(Split.EVAL, 1)[..., 0]
    # Shadows do not change what is covered, so all that does is a solid that moves.
    assert bool(mask[alpha.amax(0) - alpha.amin(0) == 255].all())
    assert 0.05 < float(mask.double().mean()) < 0.4
    # At every time the same: also where a solid has been, and where it will be.
    assert torch.equal(mask, moving.moving_mask(Split.EVAL, 1)[..., 0])


def test_solids_that_move_deform_appear_or_vanish_change():
    changing = {solid.name for solid in solids(0) if solid.changes}
    assert changing == {"crate", "ball", "drop", "pebble", "cone"}


def test_casting_in_two_threads_leaves_the_number_of_threads_as_it_was():
    import threading

    from gsfw.datamanagers.synthetic.raycast import one_thread

    before, both_cast, one_is_done = torch.get_num_threads(), threading.Event(), threading.Event()
    found: list[int] = []

    def first() -> None:
        with one_thread():
            other.start()
            both_cast.wait(10)
        one_is_done.set()

    def second() -> None:
        with one_thread():
            both_cast.set()
            one_is_done.wait(10)

    other = threading.Thread(target=second)
    torch.set_num_threads(2)
    try:
        for target in (first, lambda: found.append(torch.get_num_threads())):
            thread = threading.Thread(target=target)
            thread.start()
            thread.join()
            other.join()
    finally:
        torch.set_num_threads(before)
    assert found == [2]
