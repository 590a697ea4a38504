"""Decoder: maps the features of a place and a time to the changes of a Gaussian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import linear as linear_function

from gsfw.core.operators import Gate, Layer, Operators
from gsfw.methods.gaussians4d.layers import linear, zero_linear


@dataclass(frozen=True)
class HiddenLayers:
    """Hidden layers of a decoder."""

    width: int
    """Width of the shared layers."""
    depth: int
    """Number of shared layers; with 0 outputs are linear in the features."""
    head_width: int
    """Width of the hidden layer that each quantity has behind the shared ones; 0: none."""


class Decoder(nn.Module):
    """Shared linear layers, perhaps a hidden layer for each quantity, and an output layer for each.

    Outputs start at exactly zero, unlike those of the released code of Wu et al. 2024.
    """

    def __init__(
        self,
        features: int,
        layers: HiddenLayers,
        outputs: Mapping[str, int],
        operators: Operators,
        generator: torch.Generator,
    ) -> None:
        """Initialise the layers at random.

        Args:
            features: number of input features.
            layers: sizes of the hidden layers.
            outputs: number of values of each quantity, by name.
            operators: for the network.
            generator: generator on the CPU.
        """
        super().__init__()
        self._operators = operators
        width, head = layers.width, layers.head_width
        counts = [features, *[width] * layers.depth]
        self.shared = nn.ModuleList([linear(count, width, generator) for count in counts[:-1]])
        # The hidden layers of all quantities are one matrix: a single product instead of several.
        joined = head * len(outputs)
        self.hidden = linear(counts[-1], joined, generator) if head > 0 else None
        self.outputs = nn.ModuleDict(
            {name: zero_linear(head or counts[-1], count) for name, count in outputs.items()}
        )

    def forward(
        self,
        features: Float[Tensor, "n f"],
        only: str | None = None,
        least: tuple[str, Float[Tensor, " n"]] | None = None,
    ) -> dict[str, Float[Tensor, "n _"]]:
        """Values of each quantity.

        Args:
            features: features of each row.
            only: name of the one quantity that is wanted; ``None`` for all.
            least: name of a quantity, and its value in each row below which the others may be 0.
        """
        names = [*self.outputs] if only is None else [only]
        heads = [_parameters(self.outputs[name]) for name in names]
        layers = [_parameters(layer) for layer in self.shared]
        if self.hidden is not None:
            layers.append(self._hidden_layer(only))
            gate = None if least is None else Gate(names.index(least[0]), least[1])
            values = self._operators.relu_network(features, layers, heads, gate)
            return dict(zip(names, values, strict=True))
        # Without hidden layers of their own, all quantities are one product too.
        weights, biases = (torch.cat(parts) for parts in zip(*heads, strict=True))
        if layers:
            (joined,) = self._operators.relu_network(features, layers, [(weights, biases)])
        else:
            joined = linear_function(features, weights, biases)
        parts = joined.split([len(bias) for _, bias in heads], dim=1)
        return dict(zip(names, parts, strict=True))

    def _hidden_layer(self, only: str | None) -> Layer:
        """Hidden layer of all quantities, or the part of one."""
        assert self.hidden is not None
        weights, biases = _parameters(self.hidden)
        if only is None:
            return weights, biases
        width = len(biases) // len(self.outputs)
        start = [*self.outputs].index(only) * width
        return weights[start : start + width], biases[start : start + width]


def _parameters(layer: nn.Module) -> Layer:
    assert isinstance(layer, nn.Linear)
    return layer.weight, layer.bias
