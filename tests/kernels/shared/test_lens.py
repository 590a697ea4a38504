"""Lenses and their gradients, against the reference under autograd."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera

from gsfw.core.cameras import CameraModel
from gsfw.core.maths.lens import project_points
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings

pytestmark = pytest.mark.slow  # Compiles the headers; plain runs test them in the rasterizers.

SLOPES = [0.0, 1e-12, 1e-6, 1e-3, 0.09, 0.11, 0.3, 0.33, 0.6, 1.5, 8.0, 1e3]
"""On the axis, on both sides of where the series end, on both sides of the pinhole's limits."""

DEPTHS = [1e-3, 0.7, 40.0]


def points_in_view() -> torch.Tensor:
    turns = torch.tensor([[1.0, 0.0], [0.6, -0.8], [-0.5, -0.1]], dtype=torch.float64)
    slopes = torch.tensor(SLOPES, dtype=torch.float64)[:, None, None] * turns
    slopes = slopes.reshape(-1, 2)
    points = [torch.cat([slopes * z, torch.full((len(slopes), 1), z)], dim=1) for z in DEPTHS]
    return torch.cat(points).double()


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("kind", ["double", "single", "pair"])
def test_lenses_see_as_the_reference_does(request, kind, model):
    maths = request.getfixturevalue(kind)
    # At 89.9 degrees the fisheye's radial derivative is a thousandth of what it is summed from.
    forward, backward = (1e-6, 3e-4) if kind == "single" else (1e-13, 1e-11)
    camera = replace(front_camera(dtype=torch.float64), model=model)
    points = points_in_view().to(maths.dtype).double().requires_grad_()
    generator = torch.Generator().manual_seed(1)
    gradients = torch.randn(len(points), 8, generator=generator, dtype=torch.float64)
    pixels, jacobians = project_points(points, camera, DEFAULT.jacobian_margin)
    outputs = torch.cat([pixels, jacobians.flatten(1)], dim=1)
    (expected,) = torch.autograd.grad(outputs, points, gradients)

    mine, jacobian, found = maths.see(points, camera, RenderSettings(), gradients)

    def error(value: torch.Tensor, wanted: torch.Tensor) -> float:
        """The largest error of a row, relative to the row."""
        difference = (value.double() - wanted).flatten(1).norm(dim=1)
        return float((difference / wanted.flatten(1).norm(dim=1)).detach().max())

    assert error(mine, pixels) < forward
    assert error(jacobian, jacobians) < forward * 10
    assert error(found, expected) < backward


def test_an_infinite_slope_is_no_number_in_a_fisheye(single):
    """Its square is beyond float32: the Jacobian must fail the tests for visibility."""
    camera = replace(front_camera(), model=CameraModel.FISHEYE)
    points = torch.tensor([[1e15, 0.0, 1e-6]])
    _, jacobian, _ = single.see(points, camera, RenderSettings(), torch.zeros(1, 8))
    assert jacobian.isnan().any()


def test_the_camera_centre_has_the_gradient_of_autograd(double):
    camera = front_camera(dtype=torch.float64)
    generator = torch.Generator().manual_seed(2)
    pose = torch.randn(1, 4, 4, generator=generator, dtype=torch.float64).requires_grad_()
    gradients = torch.randn(3, 3, generator=generator, dtype=torch.float64)
    camera = replace(camera, world_to_camera=pose)
    centers, found = double.camera_center(camera, gradients)
    for row in range(3):
        torch.testing.assert_close(centers[row], camera.centers[0].detach())
        (expected,) = torch.autograd.grad(camera.centers[0], pose, gradients[row])
        torch.testing.assert_close(found[row], expected[0, :3])
