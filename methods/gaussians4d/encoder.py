"""Encoder: features of places and times for the network that deforms Gaussians."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from jaxtyping import Float
from torch import Tensor, nn


class Encoder(nn.Module, ABC):
    """Features of places at a time."""

    detached: ClassVar[bool]
    """True if places are detached: no gradient of the features moves a Gaussian."""
    features: int
    """Number of features of a place."""

    @abstractmethod
    def forward(
        self, places: Float[Tensor, "n 3"], time: Float[Tensor, ""]
    ) -> Float[Tensor, "n f"]:
        """Features of places in [-1, 1] at one time in [0, 1]."""

    def grids(self) -> tuple[nn.Parameter, ...]:
        """Parameters with cells in space and time, which have a learning rate of their own."""
        return ()

    def regularizers(self) -> Mapping[str, Tensor]:
        """Weighted scalars to add to the loss, by name."""
        return {}
