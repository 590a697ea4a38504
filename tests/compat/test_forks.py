"""Settings, arguments and functions of forks of diff-gaussian-rasterization."""

import math

import pytest
import torch
from support import inria_formulas as original
from support.inria_scene import (
    CLOSE,
    eight_splats,
    rendered,
    small_camera,
    weights,
    with_gradients,
)

from gsfw.compat import gsplat_relocation
from gsfw.compat.diff_gaussian_rasterization import GaussianRasterizer, compute_relocation
from gsfw.compat.refusal import UnservedArgument


@pytest.mark.parametrize("size", [0.1, 0.3])
def test_images_radii_and_gradients_with_a_kernel_size_are_those_of_mip_splatting(size):
    settings = small_camera()._replace(kernel_size=size)
    ours, theirs = with_gradients(eight_splats()), with_gradients(eight_splats())
    color, radii = rendered(ours, settings)
    splats = theirs.projected(settings)
    expected = original.render(splats, settings).color
    torch.testing.assert_close(color, expected, **CLOSE)
    assert radii.tolist() == [original.radius(conic) for conic in splats.conics.detach()]
    (color * weights(color)).sum().backward()
    (expected * weights(expected)).sum().backward()
    for mine, other in zip(ours.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(mine.grad, other.grad, **CLOSE)


def test_a_splat_without_area_is_not_rendered_with_a_kernel_size_and_has_finite_gradients():
    settings = small_camera()._replace(kernel_size=0.1)
    scene = eight_splats()
    scene.scales[:] = 1e-7
    scene = with_gradients(scene)
    color, _ = rendered(scene, settings)
    torch.testing.assert_close(color, settings.bg[:, None, None].expand_as(color))
    color.sum().backward()
    assert all(tensor.grad.isfinite().all() for tensor in scene.parameters())


def test_mip_splatting_reads_absolute_gradients_from_the_third_column_of_viewspace_points():
    settings = small_camera()._replace(kernel_size=0.1)
    scene = eight_splats()
    points = torch.zeros_like(scene.means, requires_grad=True)
    color, _ = rendered(scene, settings, means2D=points)
    (color * weights(color)).sum().backward()
    splats = scene.projected(settings)
    signed, absolute = original.screen_gradients(splats, settings, weights(color))
    torch.testing.assert_close(points.grad[:, :2], signed, **CLOSE)
    torch.testing.assert_close(points.grad[:, 2], absolute.norm(dim=1), **CLOSE)


def test_only_a_subpixel_offset_of_zero_is_accepted():
    settings, scene = small_camera()._replace(kernel_size=0.1), eight_splats()
    fields = settings._asdict() | {"subpixel_offset": torch.zeros(18, 22, 2)}
    same = type(settings)(**fields)
    assert torch.equal(rendered(scene, same)[0], rendered(scene, settings)[0])
    fields["subpixel_offset"] = torch.full((18, 22, 2), 0.5)
    with pytest.raises(UnservedArgument, match=r"subpixel_offset that is not 0.*\n.*ray_jitter"):
        type(settings)(**fields)


def test_first_coefficients_in_dc_and_the_others_in_shs_render_the_same():
    settings, scene = small_camera(), eight_splats()
    expected, _ = rendered(scene, settings)
    split, _ = rendered(scene, settings, dc=scene.shs[:, :1], shs=scene.shs[:, 1:])
    assert torch.equal(split, expected)
    flat = settings._replace(sh_degree=0)
    alone, _ = rendered(scene, flat, dc=scene.shs[:, :1], shs=None)
    assert torch.equal(alone, rendered(scene, flat)[0])


def test_the_visible_filter_gives_the_radii_of_a_render():
    settings, scene = small_camera(), eight_splats()
    scene.means[2] = settings.campos - 2.0 * settings.viewmatrix[:3, 2]
    rasterizer = GaussianRasterizer(settings)
    radii = rasterizer.visible_filter(scene.means, scene.scales, scene.rotations)
    assert radii.tolist() == rendered(scene, settings)[1].tolist()
    assert radii[2] == 0
    with pytest.raises(ValueError, match="either scales and rotations, or cov3D_precomp"):
        rasterizer.visible_filter(scene.means, scene.scales)


def published_sum(share: float, copies: int) -> float:
    """The double sum of Kheradmand et al. 2024, equation 9."""
    return sum(
        math.comb(i - 1, k) * (-1) ** k * share ** (k + 1) / math.sqrt(k + 1)
        for i in range(1, copies + 1)
        for k in range(i)
    )


SCALES = torch.tensor([[1.0, 2.0, 4.0]] * 2)
BINOMS = torch.zeros(51, 51)


def test_relocated_copies_have_the_opacity_and_scale_of_the_published_sum():
    opacity, share = torch.tensor([0.6, 0.6]), 1 - 0.4 ** (1 / 3)
    new_opacity, new_scale = compute_relocation(opacity, SCALES, torch.tensor([3, 1]), BINOMS, 51)
    torch.testing.assert_close(new_opacity, torch.tensor([share, 0.6]))
    factors = torch.tensor([[0.6 / published_sum(share, 3)], [1.0]])
    torch.testing.assert_close(new_scale, SCALES * factors)


def test_gsplat_lifts_faint_copies_before_it_computes_their_scale():
    opacity, copies = torch.tensor([0.6, 0.006]), torch.tensor([3, 4])
    new_opacity, new_scale = gsplat_relocation.compute_relocation(opacity, SCALES, copies, BINOMS)
    share = 1 - 0.4 ** (1 / 3)
    torch.testing.assert_close(new_opacity, torch.tensor([share, 0.005]))
    factors = [[0.6 / published_sum(share, 3)], [0.006 / published_sum(0.005, 4)]]
    torch.testing.assert_close(new_scale, SCALES * torch.tensor(factors))
