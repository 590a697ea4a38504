"""Encoder mlp: a network of sines and cosines of place and time.

Yang et al. 2024, "Deformable 3D Gaussians for High-Fidelity Monocular Dynamic Scene
Reconstruction", section 3.2: positional encoding (equation 4), time through a small network of its
own, 8 layers of 256 with the input concatenated again in the middle; positions are detached at its
input. Frequencies are 1, 2, 4, ... as in the released code; equation 4 has pi times them. Unlike
there, places are box coordinates in [-1, 1], so that frequencies do not depend on the scene's unit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import relu

from gsfw.methods.gaussians4d.encoder import Encoder
from gsfw.methods.gaussians4d.layers import linear

if TYPE_CHECKING:
    from gsfw.methods.gaussians4d.config import MlpConfig

TIME_FEATURES = 30
"""Outputs of the network of time (Yang et al. 2024, released code)."""


class FrequencyMlp(Encoder):
    """The last hidden layer of a network over frequencies of place and time."""

    detached = True

    def __init__(self, config: MlpConfig, generator: torch.Generator) -> None:
        """Initialise the layers at random."""
        super().__init__()
        self._config = config
        self.features = width = config.width
        self._join = config.depth // 2
        self.timing = nn.ModuleList(
            [
                linear(1 + 2 * config.time_frequencies, width, generator),
                linear(width, TIME_FEATURES, generator),
            ]
        )
        given = 3 * (1 + 2 * config.frequencies) + TIME_FEATURES
        inputs = [given, *[width] * (config.depth - 1)]
        if config.depth > 1:
            inputs[self._join] += given
        self.layers = nn.ModuleList([linear(count, width, generator) for count in inputs])

    def forward(
        self, places: Float[Tensor, "n 3"], time: Float[Tensor, ""]
    ) -> Float[Tensor, "n f"]:
        """Features after the last hidden layer's ReLU."""
        first, second = self.timing
        moment = _frequencies(time.to(places).view(1, 1), self._config.time_frequencies)
        moment = second(relu(first(moment))).expand(len(places), -1)
        given = torch.cat([_frequencies(places, self._config.frequencies), moment], dim=1)
        hidden = given
        for depth, layer in enumerate(self.layers):
            if depth == self._join and depth > 0:
                hidden = torch.cat([given, hidden], dim=1)
            hidden = relu(layer(hidden))
        return hidden


def _frequencies(values: Float[Tensor, "n d"], count: int) -> Float[Tensor, "n e"]:
    """The values, and sine and cosine of 1, 2, 4, ... times them."""
    scales = 2.0 ** torch.arange(count, device=values.device)
    angles = (values[:, :, None] * scales.to(values)).flatten(1)
    return torch.cat([values, angles.sin(), angles.cos()], dim=1)
