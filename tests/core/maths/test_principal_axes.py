"""Splats given by covariances, as files have them."""

from dataclasses import replace

import torch
from support.scenes import front_camera, random_splats

from gsfw.core.maths.principal_axes import with_axes
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def by_covariances(axes: torch.Tensor, splats: Splats) -> Splats:
    return replace(splats, quats=None, scales=None, covariances=axes @ axes.transpose(1, 2))


def test_splats_with_axes_look_as_their_covariances_do():
    splats = random_splats(40, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    axes = 0.1 * torch.randn(40, 3, 3, generator=generator, dtype=torch.float64)
    given = by_covariances(axes, splats)
    turned = with_axes(given)
    assert turned.covariances is None
    camera, settings = front_camera(dtype=torch.float64), RenderSettings()
    drawn = [ReferenceRasterizer().render(each, camera, settings).color for each in (given, turned)]
    torch.testing.assert_close(drawn[0], drawn[1], rtol=0, atol=1e-12)


def test_flat_and_vanishing_covariances_have_scales_of_zero():
    splats = random_splats(2)
    axes = torch.zeros(2, 3, 3)
    axes[0, 0, 0], axes[0, 1, 1] = 2.0, 3.0
    turned = with_axes(by_covariances(axes, splats))
    assert turned.scales is not None
    assert turned.quats is not None
    torch.testing.assert_close(turned.scales, torch.tensor([[0.0, 2, 3], [0, 0, 0]]))
    torch.testing.assert_close(turned.quats.norm(dim=1), torch.ones(2))
    assert turned.scales.dtype == turned.quats.dtype == torch.float32


def test_splats_that_have_axes_stay_as_they_are():
    splats = random_splats(3)
    assert with_axes(splats) is splats
    none = random_splats(0)
    assert len(with_axes(by_covariances(torch.zeros(0, 3, 3), none))) == 0
