"""Scenes laid out in pixels, for cases worked out by hand: one scene unit is one pixel."""

from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.splats import Splats


def flat_camera(width: int, height: int) -> Cameras:
    """An orthographic camera that draws the point (x, y, z) at pixel (x, y), depth z."""
    return Cameras(
        torch.eye(4, dtype=torch.float64)[None],
        torch.eye(3, dtype=torch.float64)[None],
        width,
        height,
        CameraModel.ORTHOGRAPHIC,
    )


def dots(
    centres: list[list[float]], opacities: list[float], dtype: torch.dtype = torch.float64
) -> Splats:
    """Points without extent, which the dilation alone makes visible, in the colours 1, 2, 3..."""
    n = len(centres)
    return Splats(
        means=torch.tensor(centres, dtype=dtype).view(n, 3),
        opacities=torch.tensor(opacities, dtype=dtype),
        colors=torch.arange(1.0, n + 1, dtype=dtype)[:, None],
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=dtype).repeat(n, 1),
        scales=torch.zeros(n, 3, dtype=dtype),
    )


def leaves(splats: Splats) -> Splats:
    """The same splats, with tensors that gather gradients."""
    assert isinstance(splats.colors, torch.Tensor)
    named = {name: t.detach().clone().requires_grad_() for name, t in splats.tensors().items()}
    return replace(splats, **named)
