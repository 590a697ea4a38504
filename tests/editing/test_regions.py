"""Regions say which points are inside; frustums are those of the cameras' images."""

from dataclasses import replace

import torch
from support.scenes import front_camera, turned_camera

from gsfw.core.cameras import CameraModel
from gsfw.editing.regions import Box, Sphere, num_cameras_around

POINTS = torch.tensor([[0.0, 0, 0], [1, 1, 1], [1.001, 0, 0], [0, -2, 0]], dtype=torch.float64)


def test_a_box_has_its_faces_and_takes_corners_in_any_order():
    for box in (Box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)), Box((1.0, -1.0, 1.0), (-1.0, 1.0, -1.0))):
        assert box.contains(POINTS).tolist() == [True, True, False, False]


def test_a_sphere_has_its_surface():
    assert Sphere((0.0, -1.0, 0.0), 1.0).contains(POINTS).tolist() == [True, False, False, True]
    assert Sphere((0.0, 0.0, 0.0), 0.0).contains(POINTS).tolist() == [True, False, False, False]


def test_points_in_front_and_in_the_image_are_in_the_frustum_of_a_camera():
    camera = front_camera(32, 24, 3.0, dtype=torch.float64)
    focal = float(camera.intrinsics[0, 0, 0])
    edge = 16 * 3.0 / focal  # Projects to the right edge of the image.
    points = torch.tensor(
        [[0, 0, 0], [edge - 1e-6, 0, 0], [edge + 1e-6, 0, 0], [0, 0, -4]], dtype=torch.float64
    )
    assert num_cameras_around(points, [camera]).tolist() == [1, 1, 0, 0]
    assert num_cameras_around(points, [camera, camera]).tolist() == [2, 2, 0, 0]


def test_every_projection_model_has_the_frustum_of_its_own_image():
    generator = torch.Generator().manual_seed(0)
    points = torch.randn(500, 3, generator=generator, dtype=torch.float64)
    for model in CameraModel:
        camera = turned_camera(model)
        half = replace(camera, width=camera.width // 2)
        inside, left = num_cameras_around(points, [camera]), num_cameras_around(points, [half])
        assert 0 < int(left.sum()) < int(inside.sum()) < 500
        assert bool((left <= inside).all())
