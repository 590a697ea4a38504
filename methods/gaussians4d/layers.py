"""Layers with weights from a generator, so that the same seed gives the same network."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


def linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """A linear layer with weights as in Glorot and Bengio 2010, and biases as in torch."""
    layer = _unfilled(inputs, outputs)
    _fill(layer.weight, math.sqrt(6 / (inputs + outputs)), generator)
    _fill(layer.bias, 1 / math.sqrt(inputs), generator)
    return layer


def zero_linear(inputs: int, outputs: int) -> nn.Linear:
    """A linear layer with an output of zero before training."""
    layer = _unfilled(inputs, outputs)
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer


def _unfilled(inputs: int, outputs: int) -> nn.Linear:
    """A linear layer that takes no number from torch's own generator.

    torch's skip_init does the same, but it imports sympy, which takes half a second.
    """
    with torch.random.fork_rng(devices=[]):
        return nn.Linear(inputs, outputs)


@torch.no_grad()
def _fill(tensor: Tensor, bound: float, generator: torch.Generator) -> None:
    tensor.copy_(uniform(tuple(tensor.shape), -bound, bound, generator))


def uniform(shape: tuple[int, ...], low: float, high: float, generator: torch.Generator) -> Tensor:
    """Uniform random numbers between ``low`` and ``high``."""
    return low + (high - low) * torch.rand(shape, generator=generator)
