"""The casting of rays: its images are exact, however they are cast."""

import math

import pytest
import torch
from support.built_in_scene import INSIDE

from gsfw.core.cameras import Cameras
from gsfw.datamanagers.synthetic import raycast
from gsfw.datamanagers.synthetic.dome import dome
from gsfw.datamanagers.synthetic.motion import Still
from gsfw.datamanagers.synthetic.raycast import SUBPIXELS, photograph, project, rays
from gsfw.datamanagers.synthetic.scene import LIGHT, Solid, SyntheticScene, solids
from gsfw.datamanagers.synthetic.shapes import Sphere
from gsfw.datamanagers.synthetic.textures import Bands


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
