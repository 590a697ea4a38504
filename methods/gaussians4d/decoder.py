"""Decoder: maps the features of a place and a time to the changes of a Gaussian."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import linear as linear_function

from gsfw.core.operators import Layer, Operators
from gsfw.methods.gaussians4d.layers import linear, zero_linear


class Decoder(nn.Module):
    """Shared linear layers, and a hidden layer and an output layer for each quantity.

    Outputs start at exactly zero, unlike those of the released code of Wu et al. 2024.
    """

    def __init__(
        self,
        features: int,
        width: int,
        depth: int,
        outputs: Mapping[str, int],
        operators: Operators,
        generator: torch.Generator,
    ) -> None:
        """Initialise the layers at random.

        Args:
            features: number of input features.
            width: width of all hidden layers.
            depth: number of shared layers; with 0 outputs are linear in the features.
            outputs: number of values of each quantity, by name.
            operators: for the network.
            generator: generator on the CPU.
        """
        super().__init__()
        self._operators = operators
        counts = [features, *[width] * depth]
        self.shared = nn.ModuleList([linear(inputs, width, generator) for inputs in counts[:depth]])
        # The hidden layers of all quantities are one matrix: a single product instead of several.
        self.hidden = linear(width, width * len(outputs), generator) if depth > 0 else None
        self.outputs = nn.ModuleDict(
            {name: zero_linear(counts[-1], count) for name, count in outputs.items()}
        )

    def forward(self, features: Float[Tensor, "n f"]) -> dict[str, Float[Tensor, "n _"]]:
        """Values of each quantity."""
        heads = [_parameters(output) for output in self.outputs.values()]
        if self.hidden is None:
            values = tuple(linear_function(features, *head) for head in heads)
        else:
            layers = [_parameters(layer) for layer in (*self.shared, self.hidden)]
            values = self._operators.relu_network(features, layers, heads)
        return dict(zip(self.outputs, values, strict=True))


def _parameters(layer: nn.Module) -> Layer:
    assert isinstance(layer, nn.Linear)
    return layer.weight, layer.bias
