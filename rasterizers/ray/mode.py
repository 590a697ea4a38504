"""Blended: what a mode makes of some rays, and how it is made again for the backward pass."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.numerics import NumericsProfile
from gsfw.rasterizers.ray.camera_rays import Rays
from gsfw.rasterizers.ray.gaussians import Gaussians


@dataclass(frozen=True)
class Blended:
    """``r`` rays with what they meet of ``m`` Gaussians."""

    channels: Float[Tensor, "r d"]
    """Over zeros."""
    depths: Float[Tensor, "r 1"]
    """Sum of weight times view depth."""
    weights: Float[Tensor, "r 1"]
    """Sum of the weights."""
    left: Float[Tensor, "r 1"]
    """Transmittance that remains."""
    contributions: Float[Tensor, " m"]
    """Sum over rays of each Gaussian's weight times the ray's; without gradient."""
    touched: Bool[Tensor, "r m"]
    """Pairs of a Gaussian and a ray that would show it, were it alone."""


class Mode(ABC):
    """A way to see Gaussians along rays."""

    @abstractmethod
    def pairs(self) -> int:
        """Evaluations of a Gaussian that one ray takes for each."""

    @abstractmethod
    def offsets(self, rays: int, tile: int) -> Float[Tensor, "r s"]:
        """Random numbers in [0, 1) that so many rays of a tile take, the same each time."""

    @abstractmethod
    def blend(
        self,
        rays: Rays,
        offsets: Float[Tensor, "r s"],
        gaussians: Gaussians,
        channels: Float[Tensor, "m d"],
        profile: NumericsProfile,
    ) -> Blended:
        """See Gaussians, given from front to back, with their ``channels``; differentiable."""


def recomputed(function: Callable[..., tuple[Tensor, ...]], *inputs: Tensor) -> tuple[Tensor, ...]:
    """Call ``function(*inputs)``, keep nothing, and call it again in the backward pass."""
    outputs: tuple[Tensor, ...] = _Recomputed.apply(function, *inputs)
    return outputs


class _Recomputed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, function: Any, *inputs: Tensor) -> tuple[Tensor, ...]:  # noqa: ANN401
        ctx.function = function
        ctx.save_for_backward(*inputs)
        return function(*inputs)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        wanted = ctx.needs_input_grad[1:]
        inputs = [
            tensor.detach().requires_grad_(wants)
            for tensor, wants in zip(ctx.saved_tensors, wanted, strict=True)
        ]
        with torch.enable_grad():
            outputs = ctx.function(*inputs)
        reached = [
            (output, gradient)
            for output, gradient in zip(outputs, gradients, strict=True)
            if output.requires_grad
        ]
        leaves = [tensor for tensor, wants in zip(inputs, wanted, strict=True) if wants]
        found = iter(
            torch.autograd.grad(
                [output for output, _ in reached],
                leaves,
                [gradient for _, gradient in reached],
                allow_unused=True,
            )
        )
        return None, *(next(found) if wants else None for wants in wanted)
