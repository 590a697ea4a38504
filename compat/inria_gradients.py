"""Gradients of centres in the image, as trainers read them from diff-gaussian-rasterization."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from gsfw.api import RenderStatistics
from gsfw.compat.inria_projection import InriaView


class ScreenGradient(torch.autograd.Function):
    """Zeros [m, 2] that hand the gradient of centres in the image to ``means2D``."""

    @staticmethod
    def forward(ctx: Any, means2D: Tensor, view: InriaView) -> Tensor:  # noqa: ANN401
        """Zeros."""
        ctx.half_size, ctx.columns = view.half_size(means2D), means2D.shape[1]
        return torch.zeros_like(means2D[:, :2])

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:  # noqa: ANN401
        """The gradient in normalized device coordinates."""
        whole = gradient.new_zeros(len(gradient), ctx.columns)
        whole[:, :2] = gradient * ctx.half_size
        return whole, None


class AbsoluteGradient(torch.autograd.Function):
    """Zeros [m, 2] that hand measured sums of absolute gradients to a column of a tensor [m, 3].

    Backward runs after that of the render, which depends on its output; by then the statistics are
    written.
    """

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        receiver: Tensor,
        column: int,
        measured: list[RenderStatistics],
    ) -> Tensor:
        """Zeros."""
        ctx.column, ctx.measured = column, measured
        return torch.zeros_like(receiver[:, :2])

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # noqa: ANN401
        """The measured sums, whatever the gradient is."""
        (statistics,) = ctx.measured
        assert statistics.absgrad is not None, "it was asked for"
        whole = gradient.new_zeros(len(gradient), 3)
        whole[:, ctx.column] = statistics.absgrad[0]
        return whole, None, None
