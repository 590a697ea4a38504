"""The catalogue of extremes: whatever passes validation is drawn without NaN or infinity."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats

EVERYTHING = RenderSettings(
    antialias=True, depth=Depth.EXPECTED, statistics=frozenset(Statistic), near=1e-7
)


def draw_and_check(
    rasterizer: Rasterizer, splats: Splats, cameras: Cameras, settings: RenderSettings = EVERYTHING
) -> RenderOutput:
    """Draw, go back, and check that all values and gradients are finite."""
    inputs = {name: t.clone().requires_grad_() for name, t in splats.tensors().items()}
    if isinstance(splats.colors, Sh):
        colors: Sh | torch.Tensor = replace(splats.colors, coefficients=inputs["colors"])
    else:
        colors = inputs["colors"]
    posed = replace(cameras, world_to_camera=cameras.world_to_camera.clone().requires_grad_())
    scene = replace(splats, **(inputs | {"colors": colors}))
    output = rasterizer.render(scene, posed, settings)
    loss = output.color.square().mean() + output.alpha.mean()
    if output.depth is not None:
        loss = loss + output.depth.mean()
    loss.backward()
    statistics = output.statistics
    values = {
        "color": output.color,
        "alpha": output.alpha,
        "depth": output.depth,
        "radii": statistics.radii,
        "screen gradient": statistics.screen_gradient,
        "absgrad": statistics.absgrad,
        "contribution": statistics.contribution,
        "gradient of world_to_camera": posed.world_to_camera.grad,
    }
    values |= {f"gradient of {name}": tensor.grad for name, tensor in inputs.items()}
    for name, value in values.items():
        assert value is None or value.isfinite().all(), name
    assert output.alpha.min() >= 0
    assert output.alpha.max() <= 1
    return output


def scaled(factors: list[float]) -> Callable[[Splats], Splats]:
    def change(splats: Splats) -> Splats:
        assert splats.scales is not None
        return replace(splats, scales=splats.scales * splats.scales.new_tensor(factors))

    return change


def moved(depths: list[float]) -> Callable[[Splats], Splats]:
    """Splats at these view depths, straight ahead and to the side."""

    def change(splats: Splats) -> Splats:
        means = splats.means.clone()
        n = len(means)
        means[:, 2] = means.new_tensor(depths).repeat(n)[:n] - 4
        means[: n // 2, :2] = 0
        return replace(splats, means=means)

    return change


def with_quats(quat: list[float]) -> Callable[[Splats], Splats]:
    return lambda splats: replace(splats, quats=splats.means.new_tensor([quat]).repeat(20, 1))


def with_opacity(value: float) -> Callable[[Splats], Splats]:
    return lambda splats: replace(splats, opacities=torch.full_like(splats.opacities, value))


def covariances(kind: str) -> Callable[[Splats], Splats]:
    def change(splats: Splats) -> Splats:
        bases = torch.linalg.qr(torch.randn(20, 3, 3, generator=torch.Generator().manual_seed(0)))
        widths = {"zero": [0.0] * 3, "needle": [1.0, 1e-6, 1e-6], "not psd": [0.1, 0.1, -1e-6]}
        values = torch.diag(torch.tensor(widths.get(kind, [1e12] * 3)))
        made = (bases.Q @ values @ bases.Q.transpose(1, 2)).to(splats.means.dtype)
        return replace(splats, quats=None, scales=None, covariances=made)

    return change


SPLATS: dict[str, Callable[[Splats], Splats]] = {
    "scales 1e-10": scaled([1e-10] * 3),
    "scales 1e3": scaled([1e3] * 3),
    "scales 1e6": scaled([1e6] * 3),
    "scales 1e30": scaled([1e30] * 3),
    "needles": scaled([1e3, 1e-3, 1e-3]),
    "two zero scales": scaled([1.0, 0.0, 0.0]),
    "zero scales": scaled([0.0, 0.0, 0.0]),
    "zero covariances": covariances("zero"),
    "needle covariances": covariances("needle"),
    "covariances not positive by rounding": covariances("not psd"),
    "covariances 1e12": covariances("huge"),
    "quaternion 0": with_quats([0.0] * 4),
    "quaternion 1e-20": with_quats([1e-20, 2e-20, 0.0, 0.0]),
    "quaternion 1e-11": with_quats([1e-11, 2e-11, 0.0, 0.0]),
    "quaternion 1e20": with_quats([1e20, 2e20, -1e20, 0.0]),
    "quaternion 1e37": with_quats([1e37, 2e37, -1e37, 3e37]),
    "opacity 0": with_opacity(0.0),
    "opacity 1": with_opacity(1.0),
    "opacity below the cut-off": with_opacity(1 / 256),
    "at the camera": moved([0.0]),
    "around the camera": moved([-1.0, 0.0, 1e-9, 1e-6, 1e-3, 0.009999, 0.01, 0.02]),
    "depths to 1e9": moved([1e-6, 1.0, 1e3, 1e6, 1e9]),
    "equal depths": moved([4.0]),
    "around the camera, large": lambda s: moved([0.0, 1e-6, 1e-3])(scaled([1e6] * 3)(s)),
    "coefficients 1e4": lambda s: replace(s, colors=Sh(1e4 * torch.ones_like(_sh(s)), 1)),
    "negative colours": lambda s: replace(s, colors=Sh(-1e4 * torch.ones_like(_sh(s)), 1)),
    "scene of 1e-6": lambda s: replace(scaled([1e-6] * 3)(s), means=1e-6 * s.means),
    "scene of 1e6": lambda s: replace(scaled([1e6] * 3)(s), means=1e6 * s.means),
    "scene of 1e30": lambda s: replace(s, means=1e30 * s.means),
    "one splat": lambda s: Splats(
        s.means[:1], s.opacities[:1], s.means[:1, :1], s.means.new_ones(1, 4), s.means[:1].abs()
    ),
    "no splat": lambda s: Splats(
        s.means[:0], s.opacities[:0], s.means[:0, :1], s.means.new_ones(0, 4), s.means[:0]
    ),
    "32 channels": lambda s: replace(s, colors=s.opacities[:, None].repeat(1, 32)),
}


def _sh(splats: Splats) -> torch.Tensor:
    assert isinstance(splats.colors, Sh)
    return splats.colors.coefficients


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", list(SPLATS))
def test_extreme_splats_stay_finite(rasterizer, name, dtype):
    splats = SPLATS[name](random_splats(20, 1, dtype=dtype))
    for model in CameraModel:
        camera = replace(front_camera(20, 15, dtype=dtype), model=model)
        draw_and_check(rasterizer, splats, camera)
        profile = DEFAULT.without_cutoffs()
        draw_and_check(rasterizer, splats, camera, replace(EVERYTHING, profile=profile))
        draw_and_check(rasterizer, splats, camera, replace(EVERYTHING, near=0.0, far=torch.inf))


def camera_with(focal: float, principal: float = 0.5) -> Callable[[Cameras], Cameras]:
    def change(camera: Cameras) -> Cameras:
        k = camera.intrinsics.clone()
        k[0, 0, 0], k[0, 1, 1] = focal, focal
        k[0, :2, 2] = k.new_tensor([camera.width, camera.height]) * principal
        return replace(camera, intrinsics=k)

    return change


CAMERAS: dict[str, Callable[[Cameras], Cameras]] = {
    "focal 1e-2": camera_with(1e-2),
    "focal 1e6": camera_with(1e6),
    "focal 1e30": camera_with(1e30),
    "field of view 179 degrees": camera_with(0.09),
    "principal point outside": camera_with(20.0, -3.0),
    "principal point far outside": camera_with(20.0, 1e6),
}


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", list(CAMERAS))
def test_extreme_cameras_stay_finite(rasterizer, name, dtype):
    for model in CameraModel:
        camera = CAMERAS[name](replace(front_camera(20, 15, dtype=dtype), model=model))
        draw_and_check(rasterizer, random_splats(20, 1, dtype=dtype), camera)
        draw_and_check(rasterizer, SPLATS["scales 1e6"](random_splats(20, 1, dtype=dtype)), camera)
        draw_and_check(
            rasterizer, SPLATS["around the camera"](random_splats(20, 1, dtype=dtype)), camera
        )


@pytest.mark.parametrize("size", [(1, 1), (1, 4096), (4096, 1), (17, 31), (8, 8), (9, 7)])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_every_image_size_is_drawn(rasterizer, size, count):
    width, height = size
    camera = camera_with(3.0)(front_camera(width, height))
    splats = random_splats(20, 1)
    splats = Splats(
        splats.means[:count],
        splats.opacities[:count],
        Sh(_sh(splats)[:count], 1),
        quats=None if splats.quats is None else splats.quats[:count],
        scales=None if splats.scales is None else splats.scales[:count],
    )
    output = draw_and_check(rasterizer, splats, camera)
    assert output.color.shape == (1, height, width, 3)
    assert output.alpha.shape == (1, height, width, 1)
    if count == 20:
        assert output.alpha.max() > 0


def test_a_large_picture_is_a_window_of_the_same_as_a_small_one(rasterizer):
    splats = random_splats(20, 1, dtype=torch.float64)
    small = front_camera(17, 31, dtype=torch.float64)
    large = replace(small, width=64, height=48)
    # Linearisation within the margin depends on the image's size; keep splats away from it.
    images = [rasterizer.render(splats, view).color for view in (small, large)]
    torch.testing.assert_close(images[0], images[1][:, :31, :17])


def test_an_image_that_nothing_touches_is_the_background(rasterizer):
    splats = random_splats(20, 1)
    away = replace(splats, means=splats.means + torch.tensor([1000.0, 0, 0]))
    background = torch.tensor([-0.5, 0.25, 2.0])
    settings = replace(EVERYTHING, background=background)
    output = draw_and_check(rasterizer, away, front_camera(), settings)
    assert torch.equal(output.color, background.expand_as(output.color))
    assert output.alpha.max() == 0
    assert output.depth is not None
    assert output.depth.abs().max() == 0


def test_many_layers_on_one_pixel_add_up(rasterizer):
    n = 20_000
    alpha = 1 / 254
    splats = Splats(
        means=torch.zeros(n, 3, dtype=torch.float64),
        opacities=torch.full((n,), alpha, dtype=torch.float64),
        colors=torch.ones(n, 1, dtype=torch.float64),
        quats=torch.ones(n, 4, dtype=torch.float64),
        scales=torch.ones(n, 3, dtype=torch.float64),
    )
    camera = front_camera(1, 1, dtype=torch.float64)
    output = draw_and_check(
        rasterizer, splats, camera, RenderSettings(statistics=frozenset(Statistic))
    )
    left = 1.0
    while left * (1 - alpha) > 1e-4:
        left *= 1 - alpha
    assert output.alpha.item() == pytest.approx(1 - left, abs=1e-12)
    opaque = replace(splats, opacities=torch.ones_like(splats.opacities))
    # (1 - 0.99) squared is within rounding of the stop: one is drawn, or two.
    drawn = draw_and_check(rasterizer, opaque, camera, RenderSettings()).alpha.item()
    assert min(abs(drawn - 0.99), abs(drawn - 0.9999)) < 1e-12


def test_one_opaque_splat_can_cover_everything(rasterizer):
    splats = SPLATS["scales 1e6"](random_splats(1, 0))
    splats = replace(splats, opacities=torch.ones(1))
    output = draw_and_check(rasterizer, splats, front_camera(), RenderSettings())
    assert output.alpha.min().item() == pytest.approx(0.99)


def test_needles_lose_no_more_in_float32_than_their_projection_does(rasterizer):
    # Aspect 1e6 at 45 degrees: with the published determinant a c - b^2 the image is off by 0.4.
    quat = torch.tensor([[0.9238795325112867, 0.0, 0.0, 0.3826834323650898]], dtype=torch.float64)
    images = []
    for dtype in (torch.float32, torch.float64):
        splats = Splats(
            means=torch.zeros(1, 3, dtype=dtype),
            opacities=torch.ones(1, dtype=dtype),
            colors=torch.ones(1, 1, dtype=dtype),
            quats=quat.to(dtype),
            scales=torch.tensor([[1e3, 1e-3, 1e-3]], dtype=dtype),
        )
        color = rasterizer.render(splats, front_camera(64, 64, dtype=dtype)).color
        images.append(color.double())
    assert images[1].amax() > 0.9
    assert (images[0] - images[1]).abs().max() < 1e-5
