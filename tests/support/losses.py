"""Images of losses, and the losses of operators with their gradients."""

import torch
from torch import Tensor

from gsfw.core.operators import Operators


def images(shape: tuple[int, ...], dtype: torch.dtype) -> tuple[Tensor, Tensor, Tensor]:
    """A rendered image that needs a gradient, what it should look like, and a mask."""
    generator = torch.Generator().manual_seed(sum(shape))
    target = torch.rand(shape, dtype=dtype, generator=generator)
    noise = torch.randn(shape, dtype=dtype, generator=generator)
    valid = torch.rand((*shape[:3], 1), generator=generator) > 0.3
    return (target + 0.1 * noise).requires_grad_(), target, valid


def losses_and_gradients(
    operators: Operators, rendered: Tensor, target: Tensor, valid: Tensor | None
) -> list[Tensor]:
    """L1, 1 - SSIM, and the gradients of the latter and of their weighted sum."""
    l1, dssim = operators.l1_dssim(rendered, target, valid)
    (of_dssim,) = torch.autograd.grad(dssim, rendered, retain_graph=True)
    (of_both,) = torch.autograd.grad(0.8 * l1 + 0.2 * dssim, rendered)
    return [l1.detach(), dssim.detach(), of_dssim, of_both]


def relative_error(found: Tensor, expected: Tensor) -> float:
    return float((found.double() - expected).norm() / expected.norm().clamp_min(1e-30))
