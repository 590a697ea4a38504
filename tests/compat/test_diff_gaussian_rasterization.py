from dataclasses import replace

import pytest
import torch
from support import inria_formulas as original
from support.inria_scene import (
    CLOSE,
    Scene,
    eight_splats,
    rendered,
    small_camera,
    weights,
    with_gradients,
)

from gsfw.api import NumericsProfile, open_rasterizer
from gsfw.compat import backend
from gsfw.compat.diff_gaussian_rasterization import (
    GaussianRasterizationSettings,
    GaussianRasterizer,
)
from gsfw.compat.refusal import UnservedArgument


@pytest.fixture
def settings() -> GaussianRasterizationSettings:
    return small_camera()


@pytest.fixture
def scene() -> Scene:
    return eight_splats()


def test_images_and_radii_are_those_of_the_original_formulas(scene, settings):
    expected = scene.projected(settings)
    color, radii = rendered(scene, settings)
    torch.testing.assert_close(color, original.render(expected, settings).color, **CLOSE)
    assert radii.dtype == torch.int32
    assert radii.tolist() == [original.radius(conic) for conic in expected.conics]


def test_gradients_of_all_parameters_are_those_of_the_formulas(scene, settings):
    ours, theirs = with_gradients(scene), with_gradients(scene)
    color, _ = rendered(ours, settings)
    (color * weights(color)).sum().backward()
    expected = original.render(theirs.projected(settings), settings).color
    (expected * weights(expected)).sum().backward()
    for mine, other in zip(ours.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(mine.grad, other.grad, **CLOSE)


def test_gradients_of_viewspace_points_are_those_of_the_backward_kernel(scene, settings):
    points = torch.zeros_like(scene.means, requires_grad=True)
    color, _ = rendered(scene, settings, means2D=points)
    (color * weights(color)).sum().backward()
    signed, _ = original.screen_gradients(scene.projected(settings), settings, weights(color))
    torch.testing.assert_close(points.grad[:, :2], signed, **CLOSE)
    assert not points.grad[:, 2].any()


def test_a_viewspace_gradient_is_a_finite_difference_in_device_coordinates(scene, settings):
    """The unit of densification thresholds: the image is 2 wide, whatever its pixels."""
    points = torch.zeros_like(scene.means, requires_grad=True)
    color, _ = rendered(scene, settings, means2D=points)
    (color * weights(color)).sum().backward()
    step, slopes = 1e-6, []
    for axis in (0, 1):
        losses = []
        for sign in (1, -1):
            shifted = settings.projmatrix.clone()
            shifted[:, axis] += sign * step * shifted[:, 3]
            image, _ = rendered(scene, settings._replace(projmatrix=shifted))
            losses.append((image * weights(image)).sum())
        slopes.append((losses[0] - losses[1]) / (2 * step))
    torch.testing.assert_close(points.grad.sum(0)[:2], torch.stack(slopes), rtol=1e-5, atol=1e-7)


def test_densification_points_get_the_norm_of_sums_of_absolute_gradients(scene, settings):
    points = torch.zeros_like(scene.means, requires_grad=True)
    color, _, depth = rendered(scene, settings, means2D_densify=points)
    (color * weights(color)).sum().backward()
    _, absolute = original.screen_gradients(scene.projected(settings), settings, weights(color))
    torch.testing.assert_close(points.grad[:, :2].norm(dim=1), absolute.norm(dim=1), **CLOSE)
    expected = original.render(scene.projected(settings), settings)
    torch.testing.assert_close(depth, expected.depth, **CLOSE)


@pytest.mark.parametrize("antialiasing", [False, True])
def test_versions_with_antialiasing_return_inverse_depth(scene, settings, antialiasing):
    newer = settings._replace(antialiasing=antialiasing)
    expected = original.render(scene.projected(newer), newer)
    color, _, inverse = rendered(scene, newer)
    torch.testing.assert_close(color, expected.color, **CLOSE)
    torch.testing.assert_close(inverse, expected.inverse_depth, **CLOSE)


def test_forks_that_return_depth_are_told_by_the_environment(scene, settings, monkeypatch):
    monkeypatch.setenv("GSFW_THIRD_OUTPUT", "depth")
    _, _, depth = rendered(scene, settings)
    torch.testing.assert_close(
        depth, original.render(scene.projected(settings), settings).depth, **CLOSE
    )
    monkeypatch.setenv("GSFW_THIRD_OUTPUT", "deep")
    with pytest.raises(ValueError, match="expected none, depth or invdepth"):
        rendered(scene, settings)


def test_a_pixel_stops_where_the_original_stops(scene, settings):
    """Thirty splats behind one another: transmittance falls below 1e-4 before the last."""
    deep = Scene(
        *(tensor[:1].repeat(30, *[1] * (tensor.dim() - 1)) for tensor in vars(scene).values())
    )
    deep.means = torch.zeros(30, 3, dtype=torch.float64)
    deep.means[:, 2] = torch.linspace(-1, 1, 30)
    deep.opacities[:], deep.scales[:] = 0.35, 0.5
    color, _ = rendered(deep, settings)
    expected = original.render(deep.projected(settings), settings).color
    torch.testing.assert_close(color, expected, **CLOSE)


def test_precomputed_colours_and_covariances_render_the_same(scene, settings):
    splats, whole = scene.projected(settings), scene.covariances()
    halves = torch.stack([whole[:, i, j] for i in range(3) for j in range(i, 3)], dim=1)
    color, radii = GaussianRasterizer(settings)(
        means3D=scene.means,
        means2D=torch.zeros_like(scene.means),
        opacities=scene.opacities,
        colors_precomp=splats.colors,
        cov3D_precomp=halves,
    )
    expected, sizes = rendered(scene, settings)
    torch.testing.assert_close(color, expected, **CLOSE)
    assert torch.equal(radii, sizes)


def test_splats_at_the_near_plane_are_not_seen_and_have_no_gradient(scene, settings):
    behind = with_gradients(scene)
    toward = settings.viewmatrix[:3, 2]
    with torch.no_grad():
        behind.means[2] = settings.campos + 0.19 * toward
        behind.means[3] = settings.campos - 2.0 * toward
    points = torch.zeros_like(scene.means, requires_grad=True)
    color, radii = rendered(behind, settings, means2D=points)
    (color * weights(color)).sum().backward()
    seen = [0, 1, 4, 5, 6, 7]
    rest = Scene(*(tensor.detach()[seen] for tensor in behind.parameters()))
    torch.testing.assert_close(color, rendered(rest, settings)[0])
    visible = GaussianRasterizer(settings).markVisible(behind.means)
    assert (~visible).nonzero().flatten().tolist() == [2, 3]
    assert radii[[2, 3]].tolist() == [0, 0]
    assert not points.grad[[2, 3]].any()
    assert all(tensor.grad.isfinite().all() for tensor in behind.parameters())
    with pytest.raises(ValueError, match="2 of 8 splats are behind the near plane"):
        rendered(behind, settings._replace(prefiltered=True))


def test_no_splats_give_the_background(scene, settings):
    nothing = Scene(*(tensor[:0] for tensor in scene.parameters()))
    color, radii = rendered(nothing, settings)
    assert len(radii) == 0
    assert torch.equal(color, settings.bg[:, None, None].expand_as(color))


def test_any_rasterizer_can_be_chosen(scene, settings, monkeypatch):
    expected, _ = rendered(scene, settings)
    monkeypatch.setattr(backend, "_chosen", [])
    monkeypatch.setenv("GSFW_RASTERIZER", "reference")
    torch.testing.assert_close(rendered(scene, settings)[0], expected, **CLOSE)
    backend.use_rasterizer("ray")
    with pytest.raises(ValueError, match="needs feature 'screen gradient'"):
        rendered(scene, settings)
    backend.use_rasterizer("nothing")
    with pytest.raises(ValueError, match="no rasterizer 'nothing'"):
        rendered(scene, settings)


def test_each_gpu_has_a_rasterizer_of_its_own(monkeypatch):
    opened = []

    def noted(name, device, needs):
        opened.append(device)
        return open_rasterizer("reference")

    monkeypatch.setattr(backend, "open_rasterizer", noted)
    backend._opened.cache_clear()
    for index in (0, 1, 0):
        device = torch.device("cuda", index)
        backend.rasterizer_for(device, frozenset(), NumericsProfile())
    backend._opened.cache_clear()
    assert opened == [torch.device("cuda", 0), torch.device("cuda", 1)]


def test_arguments_of_forks_are_refused_by_name(scene, settings):
    with pytest.raises(UnservedArgument, match="does not support require_coord"):
        GaussianRasterizationSettings(**settings._asdict(), require_coord=True)
    with pytest.raises(UnservedArgument, match="does not support theta"):
        rendered(scene, settings, theta=scene.means)
    with pytest.raises(ValueError, match="either shs or colors_precomp"):
        rendered(scene, settings, colors_precomp=scene.means)
    with pytest.raises(ValueError, match="either scales and rotations, or cov3D_precomp"):
        GaussianRasterizer(settings)(
            scene.means, scene.means, scene.opacities, scene.shs, scales=scene.scales
        )
    with pytest.raises(ValueError, match="means2D_densify"):
        rendered(scene, settings, means2D=torch.zeros(8, 4))
    with pytest.raises(ValueError, match=r"means2D of shape \[n, 3\], found None"):
        rendered(scene, settings, means2D=None)
    with pytest.raises(ValueError, match="sh_degree=2 has 9 coefficients, but shs has 4"):
        rendered(scene, settings._replace(sh_degree=2))


def test_debug_names_values_that_cannot_be_rendered(scene, settings):
    broken = replace(scene, opacities=scene.opacities + 1)
    with pytest.raises(ValueError, match=r"opacities: expected values in \[0, 1\]"):
        rendered(broken, settings._replace(debug=True))
