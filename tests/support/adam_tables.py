"""Tables of numbers with their moments, and gradients of several sizes."""

import torch
from torch import Tensor

from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators


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


def stepped(
    operators: Operators, shape: tuple[int, ...], dtype: torch.dtype, named: bool
) -> list[Tensor]:
    """A table and its moments after two steps, of every second row if rows are named."""
    values, moments = start(shape, dtype)
    rows = torch.arange(0, shape[0], 2) if named else None
    for gradient in gradients(values, 2):
        update = AdamUpdate(values, gradient, moments, 0.01, rows)
        operators.adam_([update], AdamSettings(), torch.tensor(True))
    return [values, moments.first, moments.second]
