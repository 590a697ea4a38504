"""FeatureDecoder: maps rendered feature channels to colours.

Li et al. 2024, splatted feature rendering: six channels besides the base colour are splatted, and a
small network maps them and the ray of the pixel to a change of that colour. Two differences: the
change is multiplied by the coverage, and there is no sigmoid around the sum (as in the released
code's variant without it), so that any background keeps its exact colour. The last layer starts at
zero, so that training starts with the base colours.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.cameras import Cameras
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.render_output import RenderOutput

CHANNELS = 6
"""Number of features: three for the direction, and three for the change with time."""
RAY = 6
"""Number of ray channels: origin and direction."""
HIDDEN = 6
"""Width of the hidden layer, as in the released code."""


class FeatureDecoder(nn.Module):
    """12 -> 6 -> 3 without biases: 90 weights for the whole scene."""

    def __init__(self, generator: torch.Generator) -> None:
        super().__init__()
        inputs = CHANNELS + RAY
        bound = inputs**-0.5
        first = torch.rand(HIDDEN, inputs, generator=generator)
        self.first = nn.Parameter(bound * (2.0 * first - 1.0))
        self.second = nn.Parameter(torch.zeros(3, HIDDEN))

    def correction(
        self, features: Float[Tensor, "c h w e"], rays: Float[Tensor, "c h w 6"]
    ) -> Float[Tensor, "c h w 3"]:
        """Change of the base colour; zero without coverage."""
        inputs = torch.cat([features, rays], dim=-1)
        return (inputs @ self.first.T).relu() @ self.second.T

    def decode(self, output: RenderOutput, cameras: Cameras) -> RenderOutput:
        """The image with decoded colours; features are in ``output.extra``."""
        assert output.extra is not None
        added = self.correction(output.extra, pixel_rays(cameras).to(output.extra))
        return replace(output, color=output.color + output.alpha * added)
