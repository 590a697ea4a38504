"""Drawings whose values and gradients must all be finite."""

from dataclasses import replace

import torch

from gsfw.core.cameras import Cameras
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
