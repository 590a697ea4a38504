"""Splats moved to another frame look the same from cameras moved with them."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.maths.frame import transform_splats, with_axes
from gsfw.core.maths.similarity import Similarity
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def rotation(seed: int) -> torch.Tensor:
    """A random rotation."""
    generator = torch.Generator().manual_seed(seed)
    matrix, _ = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))
    return matrix * matrix.det()


def general(seed: int = 3) -> Similarity:
    """Another scale, another direction, another place."""
    return Similarity(2.7, rotation(seed), torch.tensor([5.0, -6.0, 7.0], dtype=torch.float64))


def draw(splats: Splats, similarity: Similarity | None = None) -> torch.Tensor:
    """A picture, from a camera that is moved along."""
    camera = front_camera(dtype=torch.float64)
    if similarity is not None:
        camera = replace(camera, world_to_camera=similarity.camera(camera.world_to_camera))
    return ReferenceRasterizer().render(splats, camera).color


@pytest.mark.parametrize("degree", range(5))
def test_moved_splats_look_the_same_from_a_camera_moved_with_them(degree):
    splats = random_splats(40, degree, dtype=torch.float64)
    before, after = draw(splats), draw(transform_splats(splats, general()), general())
    assert float(before.max()) > 0.5
    assert float((before - after).abs().max()) < 1e-9


def test_view_dependent_colours_that_were_not_turned_would_look_different():
    splats = random_splats(40, 3, dtype=torch.float64)
    moved = transform_splats(splats, general())
    unturned = draw(replace(moved, colors=splats.colors), general())
    assert float((unturned - draw(splats)).abs().max()) > 0.05


def test_covariances_and_plain_channels_are_moved_too():
    splats = random_splats(40, 0, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    factors = 0.1 * torch.randn(40, 3, 3, generator=generator, dtype=torch.float64)
    splats = Splats(
        means=splats.means,
        opacities=splats.opacities,
        colors=torch.rand(40, 3, generator=generator, dtype=torch.float64),
        covariances=factors @ factors.transpose(1, 2),
    )
    after = draw(transform_splats(splats, general()), general())
    assert float((draw(splats) - after).abs().max()) < 1e-9


def test_there_and_back_is_where_it_was_and_keeps_bands_that_are_not_active_yet():
    splats = random_splats(20, 3, dtype=torch.float64)
    splats = replace(splats, colors=Sh(splats.colors.coefficients, 1))
    back = transform_splats(transform_splats(splats, general()), general().inverse())
    assert torch.allclose(back.means, splats.means)
    assert torch.allclose(back.scales, splats.scales)
    assert back.colors.degree == 1
    assert torch.allclose(back.colors.coefficients, splats.colors.coefficients)


def test_ragged_colours_become_dense_and_look_the_same():
    dense = random_splats(6, 2, dtype=torch.float64)
    ragged = replace(dense, colors=dense.colors.of_degrees(torch.arange(6) % 3))
    moved = transform_splats(ragged, general())
    assert moved.colors.coefficients.shape == (6, 9, 3)
    assert float((draw(ragged) - draw(moved, general())).abs().max()) < 1e-9


@pytest.mark.parametrize("parts", [1, 4, 20])
def test_colours_are_turned_by_parts_as_they_are_at_once(monkeypatch, parts):
    splats = random_splats(20, 3, dtype=torch.float64)
    coefficients = splats.colors.coefficients.requires_grad_()
    split = replace(splats, colors=Sh(coefficients[:, :1], 3, coefficients[:, 1:]))
    whole = transform_splats(splats, general()).colors.coefficients
    monkeypatch.setattr("gsfw.core.maths.frame.CHUNK", -(-20 // parts))
    found = transform_splats(split, general()).colors
    assert found.rest is None
    assert torch.allclose(found.coefficients, whole, atol=1e-14)
    assert float((whole - coefficients).detach().abs().max()) > 0.01
    found.coefficients.square().sum().backward()
    assert coefficients.grad is not None


def test_float32_splats_become_float64_but_for_colors_and_the_identity_changes_nothing():
    splats = random_splats(20, 3)
    moved = transform_splats(splats, Similarity())
    for name, tensor in splats.tensors().items():
        assert moved.tensors()[name].dtype == (tensor.dtype if name == "colors" else torch.float64)
        assert torch.allclose(moved.tensors()[name].double(), tensor.double(), atol=1e-14)


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
