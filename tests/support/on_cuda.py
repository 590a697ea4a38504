"""A rasterizer on a GPU behind tensors on the CPU, so that every test can be asked of it."""

from dataclasses import fields, replace
from typing import Any

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Capabilities
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.splats import Sh, Splats

DEVICE = "cuda"


class OnCuda(Rasterizer):
    """Moves what is drawn to the GPU, and images, gradients and statistics back."""

    def __init__(self, rasterizer: Rasterizer) -> None:
        self.behind = rasterizer

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Not those of the rasterizer behind it, which an instance has."""
        return Capabilities(devices=frozenset({"cpu"}))

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        pairs: list[tuple[Tensor, Tensor]] = []
        offsets = splats.colors.offsets if isinstance(splats.colors, Sh) else None
        splats = splats.map(lambda tensor: _Move.apply(tensor, offsets, pairs))
        view = _Move.apply(cameras.world_to_camera, None, pairs)
        background, weights = settings.background, settings.contribution_weights
        settings = replace(
            settings,
            background=None if background is None else background.to(DEVICE),
            contribution_weights=None if weights is None else weights.to(DEVICE),
            validation=Validation.CHEAP,
        )
        output = self.behind.render(
            _indices_moved(splats), replace(cameras.to(DEVICE), world_to_camera=view), settings
        )
        statistics = _statistics(output.statistics, pairs)
        drawn = {name: getattr(output, name) for name in ("color", "alpha", "depth", "extra")}
        moved = {name: None if t is None else t.cpu() for name, t in drawn.items()}
        return RenderOutput(statistics=statistics, **moved)


class _Move(torch.autograd.Function):
    """To the GPU; on the way back, statistics that were written there are copied too.

    The tensors here are kept as the rasterizer keeps those there, so that changes are noticed.
    """

    @staticmethod
    def forward(ctx: Any, tensor: Tensor, offsets: Tensor | None, pairs: list) -> Tensor:
        ctx.pairs = pairs
        ctx.save_for_backward(tensor, offsets)
        return tensor.to(DEVICE)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        ctx.saved_tensors  # noqa: B018 - raises if one was changed since
        for here, there in ctx.pairs:
            here.copy_(there)
        return gradient.cpu(), None, None


def _indices_moved(splats: Splats) -> Splats:
    return splats.to(DEVICE)


def _statistics(there: RenderStatistics, pairs: list[tuple[Tensor, Tensor]]) -> RenderStatistics:
    here = {}
    for field in fields(there):
        tensor = getattr(there, field.name)
        here[field.name] = None if tensor is None else tensor.cpu()
        if tensor is not None:
            pairs.append((here[field.name], tensor))
    return RenderStatistics(**here)
