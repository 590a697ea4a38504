"""Tables of numbers with their moments, and gradients of several sizes."""

import torch
from torch import Tensor

from gsfw.core.operators import AdamMoments


def start(shape: tuple[int, ...], dtype: torch.dtype) -> tuple[Tensor, AdamMoments]:
    generator = torch.Generator().manual_seed(5)
    values = torch.randn(shape, dtype=dtype, generator=generator)
    return values, AdamMoments.zeros_like(values)


def gradients(values: Tensor, steps: int) -> list[Tensor]:
    generator = torch.Generator().manual_seed(6)
    return [
        torch.randn(values.shape, dtype=values.dtype, generator=generator) * 10.0 ** (step - 3)
        for step in range(steps)
    ]
