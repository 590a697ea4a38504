"""ParameterGroup: trained parameters that are not one per splat."""

from __future__ import annotations

from dataclasses import dataclass

from torch import nn

from gsfw.core.learning_rate import LearningRate


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters of a network or a grid that share a learning rate."""

    name: str
    """Name, unique among the model's groups and columns; used in ``lr/NAME``, reset and freeze."""
    parameters: tuple[nn.Parameter, ...]
    """The parameters, which the model also holds as an ``nn.Module``."""
    learning_rate: LearningRate
    """The rate of all of them."""
    weight_decay: float = 0.0
    """Decoupled, as in AdamW (Loshchilov and Hutter 2019)."""
