"""What torch's autograd may ask of a rasterizer, and what both must refuse."""

from dataclasses import replace

import pytest
import torch
from support.agreement import draw_everything, leaves
from support.scenes import front_camera, random_splats
from torch.autograd import forward_ad

from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh


def test_an_input_that_is_changed_before_the_way_back_is_an_error(backend):
    splats = leaves(random_splats(10, 1))
    output = backend.render(splats, front_camera())
    with torch.no_grad():
        splats.means.add_(1.0)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        output.color.sum().backward()


def test_going_back_twice_adds_the_same_gradient_twice(rasterizer):
    splats = leaves(random_splats(10, 1))
    loss = rasterizer.render(splats, front_camera()).color.square().sum()
    loss.backward(retain_graph=True)
    once = splats.means.grad.clone()
    loss.backward()
    torch.testing.assert_close(splats.means.grad, 2 * once)
    with pytest.raises(RuntimeError, match="second time"):
        loss.backward()


@pytest.mark.parametrize("wanted", ["means", "quats", "scales", "opacities", "colors", "extra"])
def test_one_input_alone_gets_the_gradient_that_it_gets_among_all(rasterizer, wanted):
    splats = replace(random_splats(30, 1), extra=torch.rand(30, 2))
    everything = draw_everything(rasterizer, splats, front_camera(), RenderSettings())
    leaf = splats.tensors()[wanted].clone().requires_grad_()
    scene = replace(splats, **{wanted: Sh(leaf, 1) if wanted == "colors" else leaf})
    output = rasterizer.render(scene, front_camera(), RenderSettings())
    generator = torch.Generator().manual_seed(0)
    loss = torch.zeros(())
    for image in (output.color, output.alpha, output.extra):
        weights = torch.randn(image.shape, generator=generator, dtype=torch.float64)
        loss = loss + (image * weights.float()).sum()
    loss.backward()
    torch.testing.assert_close(leaf.grad, everything[f"gradient of {wanted}"])


@pytest.mark.parametrize("image", ["color", "alpha", "depth", "extra"])
def test_one_image_alone_can_be_differentiated(rasterizer, image):
    settings = RenderSettings(depth=Depth.EXPECTED)
    splats = leaves(
        replace(random_splats(8, 1, dtype=torch.float64), extra=torch.rand(8, 1).double())
    )
    output = rasterizer.render(splats, front_camera(24, 18, dtype=torch.float64), settings)
    getattr(output, image).sum().backward()
    change = 1e-7

    def total(shift: float) -> float:
        moved = replace(splats, opacities=splats.opacities.detach() + shift)
        drawn = rasterizer.render(moved, front_camera(24, 18, dtype=torch.float64), settings)
        return getattr(drawn, image).sum().item()

    slope = (total(change) - total(-change)) / (2 * change)
    assert splats.opacities.grad.sum().item() == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_inputs_that_are_not_contiguous_are_drawn_as_their_copies_are(rasterizer):
    splats = replace(random_splats(30, 2), extra=torch.rand(30, 2))
    spread = splats.map(lambda tensor: torch.stack([tensor, 0 * tensor], dim=-1)[..., 0])
    assert not spread.means.is_contiguous()
    camera = front_camera()
    across = replace(
        camera,
        world_to_camera=camera.world_to_camera.transpose(1, 2).contiguous().transpose(1, 2),
        intrinsics=camera.intrinsics.transpose(1, 2).contiguous().transpose(1, 2),
    )
    settings = RenderSettings(background=torch.rand(6)[::2])
    expected = rasterizer.render(splats, camera, settings)
    leaf = leaves(spread)
    found = rasterizer.render(leaf, across, settings)
    assert torch.equal(found.color, expected.color)
    (found.color * torch.rand(1, 3, 40, 30).transpose(1, 3)).sum().backward()
    assert leaf.means.grad.isfinite().all()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(backend, dtype):
    splats = random_splats(10, 1).map(lambda tensor: tensor.to(dtype))
    with pytest.raises(ValueError, match="expected float32 or float64") as caught:
        backend.render(splats, front_camera().to(dtype=dtype))
    assert str(caught.value) == f"splats.means: expected float32 or float64, found {dtype}"


@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated")  # Torch's own use of it.
@pytest.mark.parametrize("grad", [True, False])
def test_forward_mode_derivatives_are_refused_rather_than_left_out(backend, grad):
    splats = random_splats(8, 1)
    with forward_ad.dual_level(), torch.set_grad_enabled(grad):
        means = forward_ad.make_dual(splats.means, torch.ones_like(splats.means))
        with pytest.raises(NotImplementedError, match="forward mode"):
            backend.render(replace(splats, means=means), front_camera())
