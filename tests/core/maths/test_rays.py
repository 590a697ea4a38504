"""Rays of pixels, in float64."""

import pytest
import torch
from support.scenes import turned_camera

from gsfw.core.cameras import CameraModel
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("pixel", [(5, 7), (22, 31)])
def test_what_lies_on_the_ray_of_a_pixel_is_drawn_there(model, pixel):
    camera = turned_camera(model)
    rays = pixel_rays(camera)
    assert rays.shape == (1, camera.height, camera.width, 6)
    origin, direction = rays[0, pixel[0], pixel[1]].split(3)
    assert float(direction.norm()) == pytest.approx(1.0)
    splats = Splats(
        means=(origin + 4.0 * direction)[None],
        opacities=torch.ones(1, dtype=torch.float64),
        colors=torch.ones(1, 1, dtype=torch.float64),
        quats=torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64),
        scales=torch.full((1, 3), 0.02, dtype=torch.float64),
    )
    alpha = ReferenceRasterizer().render(splats, camera, RenderSettings()).alpha[0, :, :, 0]
    rows, columns = (torch.arange(size, dtype=torch.float64) for size in alpha.shape)
    found = (
        (alpha.sum(1) * rows).sum() / alpha.sum(),
        (alpha.sum(0) * columns).sum() / alpha.sum(),
    )
    assert [float(value) for value in found] == pytest.approx(pixel, abs=0.02)


def test_a_ray_begins_at_the_camera():
    camera = turned_camera()
    origins = pixel_rays(camera)[..., :3]
    torch.testing.assert_close(origins, camera.centers.expand_as(origins))
