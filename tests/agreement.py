"""Everything that a rasterizer draws and differentiates, and how near to float64 it must be."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.numerics import NumericsProfile
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats

Drawn = Mapping[str, Tensor]
"""Pictures, statistics and, as "gradient of NAME", gradients, by name."""

PICTURES = ("color", "alpha", "depth", "extra")
STATISTICS = ("radii", "screen_gradient", "absgrad", "contribution")

FROM_ONE = ("alpha", "gradient of background")
"""What is 1 minus something: it has the rounding of 1, however small it is."""

FLIP = 1e-2
"""Most by which a pixel may differ whose list of splats does."""


def leaves(splats: Splats) -> Splats:
    """The same splats, with tensors that gather gradients."""
    return splats.map(lambda tensor: tensor.detach().clone().requires_grad_())


def as_float64(
    splats: Splats, cameras: Cameras, settings: RenderSettings
) -> tuple[Splats, Cameras, RenderSettings]:
    """The same scene, to the last bit, for the reference."""
    background = settings.background
    if background is not None:
        background = background.detach().double().requires_grad_(background.requires_grad)
    wide = splats.map(lambda tensor: tensor.double())
    return wide, cameras.to(dtype=torch.float64), replace(settings, background=background)


def draw_everything(
    rasterizer: Rasterizer, splats: Splats, cameras: Cameras, settings: RenderSettings
) -> Drawn:
    """Draw, and go back from fixed random weights of every picture.

    The gradients are those of every input, pose included, and of a background that wants its own.
    """
    scene = leaves(splats)
    view = cameras.world_to_camera.clone().requires_grad_()
    inputs = scene.tensors() | {"world_to_camera": view}
    if settings.background is not None and settings.background.requires_grad:
        inputs["background"] = settings.background.detach().clone().requires_grad_()
        settings = replace(settings, background=inputs["background"])
    output = rasterizer.render(scene, replace(cameras, world_to_camera=view), settings)
    mixed(output).backward()
    drawn = {name: getattr(output, name) for name in PICTURES}
    drawn |= {name: getattr(output.statistics, name) for name in (*STATISTICS, "visible")}
    for name, tensor in inputs.items():  # An input that is not used may be left without one.
        gradient = torch.zeros_like(tensor) if tensor.grad is None else tensor.grad
        drawn[f"gradient of {name}"] = gradient
    return {name: tensor.detach() for name, tensor in drawn.items() if tensor is not None}


def mixed(output: RenderOutput) -> Tensor:
    """A loss in which every number of every picture has its own weight."""
    generator = torch.Generator().manual_seed(0)
    total = output.color.new_zeros(())
    for name in PICTURES:
        picture = getattr(output, name)
        if picture is not None:
            weights = torch.randn(picture.shape, generator=generator, dtype=torch.float64)
            total = total + (picture * weights.to(picture.dtype)).sum()
    return total


def distance(found: Tensor, expected: Tensor, name: str) -> float:
    """|found - expected| / |expected|, in L2; of what is almost 0, the difference itself."""
    size = expected.double().norm().item()
    size = max(size, 1.0) if name in FROM_ONE else size if size > 1e-30 else 1.0
    return (found.double() - expected.double()).norm().item() / size


FUSED = {"gradient of covariances": 1e-11}
"""Bounds of kernels that fuse multiply-adds in float64: of needles given by their covariance the
determinant is a c - b^2, in which they lose fewer digits than the reference does."""


def check_float64(
    found: Drawn, expected: Drawn, bounds: Mapping[str, float] = MappingProxyType({})
) -> None:
    """A float64 backend is as near to the reference as rounding lets it: 1e-12, or its bound."""
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert found[name].dtype == tensor.dtype
        assert distance(found[name], tensor, name) <= bounds.get(name, 1e-12), name


def check_float32(found: Drawn, expected: Drawn, profile: NumericsProfile) -> None:
    """A float32 backend keeps the tolerances that the project states for ordinary scenes.

    A pixel whose list of splats differs by a rounding at a cut-off (a flip) is counted instead.
    """
    assert found.keys() == expected.keys()
    flips = 0
    for name in PICTURES:
        if name in expected:
            flips += check_picture(found[name], expected[name], name)
    smooth = profile.alpha_min == 0
    assert not (smooth and flips), "there are no cut-offs"
    tolerance = 1e-2 if flips else 1e-4 if smooth else 1e-3
    for name, tensor in expected.items():
        assert found[name].isfinite().all(), name
        if name not in PICTURES:
            assert distance(found[name], tensor, name) <= tolerance, name


def check_picture(found: Tensor, expected: Tensor, name: str) -> int:
    """Check one picture; returns the number of its pixels that flipped."""
    unit = max(1.0, expected.abs().max().item())
    difference = (found.double() - expected).abs().amax(-1) / unit
    flipped = difference > 1e-5
    count = int(flipped.sum())
    assert count <= max(1, 5e-4 * difference.numel()), f"{name}: {count} pixels are off"
    # Expected depth is a ratio: at the rim of the only splat, it is that splat's or 0.
    assert name == "depth" or difference.max() <= FLIP, name
    assert distance(found[~flipped], expected[~flipped], name) <= 1e-5, name
    return count
