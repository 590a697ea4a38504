"""The camera models: each Jacobian is the derivative of its own mapping."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera

from gsfw.core.cameras import CameraModel
from gsfw.core.maths.lens import SERIES_BELOW, project_points

EDGE = SERIES_BELOW**0.5

POINTS = torch.tensor(
    [
        [0.0, 0.0, 2.0],
        [1e-9, -1e-9, 1.0],
        [0.3, -0.2, 1.5],
        [0.999 * EDGE, 0.0, 1.0],
        [1.001 * EDGE, 0.0, 1.0],
        [-0.2, 0.35, 1.0],
    ],
    dtype=torch.float64,
)


@pytest.mark.parametrize("model", list(CameraModel))
def test_the_jacobian_is_the_derivative_of_the_pixel(model):
    camera = replace(front_camera(40, 40, dtype=torch.float64), model=model)
    for point in POINTS:
        expected = torch.autograd.functional.jacobian(
            lambda p: project_points(p[None], camera, 0.3)[0][0], point
        )
        found = project_points(point[None], camera, 0.3)[1][0]
        torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)


def test_the_fisheye_is_equidistant():
    camera = replace(front_camera(40, 30, dtype=torch.float64), model=CameraModel.FISHEYE)
    angles = torch.tensor([0.0, 0.01, 0.5, 1.0, 1.5], dtype=torch.float64)
    points = torch.stack([angles.sin(), 0 * angles, angles.cos()], dim=1)
    pixels, _ = project_points(points, camera, 0.3)
    torch.testing.assert_close(pixels[:, 0], 20 + 48 * angles)
    torch.testing.assert_close(pixels[:, 1], torch.full_like(angles, 15))


def test_the_fisheye_series_meet_the_closed_form():
    camera = replace(front_camera(40, 40, dtype=torch.float64), model=CameraModel.FISHEYE)
    sides = torch.tensor([[EDGE - 1e-15, 0.0, 1.0], [EDGE + 1e-15, 0.0, 1.0]], dtype=torch.float64)
    pixels, jacobians = project_points(sides, camera, 0.3)
    torch.testing.assert_close(pixels[0], pixels[1], rtol=1e-13, atol=1e-12)
    torch.testing.assert_close(jacobians[0], jacobians[1], rtol=1e-12, atol=1e-12)


def test_the_pinhole_jacobian_is_held_within_the_margin_of_the_real_image():
    camera = front_camera(40, 20, dtype=torch.float64)
    intrinsics = camera.intrinsics.clone()
    intrinsics[0, 0, 2] = 30.0
    camera = replace(camera, intrinsics=intrinsics)
    far_off = torch.tensor([[100.0, 0.0, 2.0], [-100.0, 0.0, 2.0]], dtype=torch.float64)
    pixels, jacobians = project_points(far_off, camera, 0.3)
    margin = 0.3 * 0.5 * 40 / 48
    slopes = torch.tensor([10 / 48 + margin, -30 / 48 - margin], dtype=torch.float64)
    torch.testing.assert_close(jacobians[:, 0, 2], -48 / 2 * slopes)
    torch.testing.assert_close(pixels[:, 0], 30 + 48 * far_off[:, 0] / 2)
