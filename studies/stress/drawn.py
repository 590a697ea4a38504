"""Drawn: all images, statistics and gradients of a rasterizer, and their distances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from gsfw.core.capabilities import Feature
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Drawing

Drawn = Mapping[str, Tensor]
"""Images, statistics and, as "gradient of NAME", gradients, by name; on the CPU."""

IMAGES = ("color", "alpha", "depth", "extra")
STATISTICS = ("radii", "screen_gradient", "absgrad", "contribution")
GRADIENT = "gradient of "

FROM_ONE = ("alpha", "gradient of background")
"""Differences from 1: they have the rounding of 1, however small they are."""


def leaves(splats: Splats) -> Splats:
    """The same splats as leaves that gather gradients."""
    return splats.map(lambda tensor: tensor.detach().clone().requires_grad_())


def draw_everything(rasterizer: Rasterizer, drawing: Drawing) -> Drawn:
    """Render, and go back from fixed random weights of every image.

    The gradients are those of every input, pose included, and of a background that wants its own;
    unless the drawing asks for fewer.
    """
    if Feature.GRADIENT not in drawing.gradients:
        return _images_of(rasterizer, drawing)
    scene, settings = leaves(drawing.splats), drawing.settings
    view = drawing.cameras.world_to_camera.clone()
    view.requires_grad_(Feature.POSE_GRADIENT in drawing.gradients)
    inputs = scene.tensors()
    if Feature.POSE_GRADIENT in drawing.gradients:
        inputs["world_to_camera"] = view
    if settings.background is not None and settings.background.requires_grad:
        inputs["background"] = settings.background.detach().clone().requires_grad_()
        settings = replace(settings, background=inputs["background"])
    cameras = replace(drawing.cameras, world_to_camera=view)
    output = rasterizer.render(scene, cameras, settings)
    mixed(output).backward()
    drawn = _outputs(output)
    for name, tensor in inputs.items():  # An input that is not used may be left without one.
        gradient = torch.zeros_like(tensor) if tensor.grad is None else tensor.grad
        drawn[f"{GRADIENT}{name}"] = gradient.detach().cpu()
    return drawn


@torch.no_grad()
def _images_of(rasterizer: Rasterizer, drawing: Drawing) -> Drawn:
    """Images and statistics alone."""
    return _outputs(rasterizer.render(drawing.splats, drawing.cameras, drawing.settings))


def _outputs(output: RenderOutput) -> dict[str, Tensor]:
    """Images and statistics of a render by name, on the CPU."""
    found: dict[str, Tensor | None] = {name: getattr(output, name) for name in IMAGES}
    found |= {name: getattr(output.statistics, name) for name in (*STATISTICS, "visible")}
    return {name: tensor.detach().cpu() for name, tensor in found.items() if tensor is not None}


def mixed(output: RenderOutput) -> Tensor:
    """A loss in which every number of every image has its own weight."""
    generator = torch.Generator().manual_seed(0)
    total = output.color.new_zeros(())
    for name in IMAGES:
        image = getattr(output, name)
        if image is not None:
            weights = torch.randn(image.shape, generator=generator, dtype=torch.float64)
            total = total + (image * weights.to(image)).sum()
    return total


def distance(found: Tensor, expected: Tensor, name: str) -> float:
    """|found - expected| / |expected| in L2; the difference where ``expected`` is almost 0."""
    size = expected.double().norm().item()
    size = max(size, 1.0) if name in FROM_ONE else size if size > 1e-30 else 1.0
    return (found.double() - expected.double()).norm().item() / size


def same_bits(first: Drawn, second: Drawn) -> bool:
    """True if two results have equal bits, with NaN in the same places."""
    return first.keys() == second.keys() and all(
        torch.equal(tensor.nan_to_num(nan=0.0), second[name].nan_to_num(nan=0.0))
        and torch.equal(tensor.isnan(), second[name].isnan())
        for name, tensor in first.items()
    )
