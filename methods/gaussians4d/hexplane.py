"""Encoder hexplane: six planes of features for the pairs of x, y, z and t, at several resolutions.

Wu et al. 2024, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering", section 4.2: features
are read from the planes by bilinear interpolation, multiplied over the planes, and concatenated
over the resolutions. Regularisers are from Fridovich-Keil et al. 2023 ("K-Planes", section 3.2).

Differences from the released code: time spans all of its planes (there it fills one half of them),
features start around 1 (see UNIT), and total variation is that of the paper (there, a second
difference along one axis). As all Gaussians are rendered at one time, time planes are first read at
that time, which leaves lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.operators import PLANE_AXES, Operators
from gsfw.methods.gaussians4d.encoder import Encoder
from gsfw.methods.gaussians4d.layers import uniform

if TYPE_CHECKING:
    from gsfw.methods.gaussians4d.config import HexPlaneConfig

SPACE_START = (0.1, 0.5)
"""Initial range of space planes; time planes start at 1, so that the product is independent of
time (K-Planes, and the released code)."""
UNIT = (sum(SPACE_START) / 2) ** -3
"""Scale that makes the product start around 1. It is 0.03 in the paper, too small for the network:
22.6 instead of 25.0 dB (built-in moving scene, 96 x 72, 1500 splats, 600 steps)."""


class HexPlane(Encoder):
    """Products of features of planes; gradients reach positions, as in the paper."""

    detached = False

    def __init__(
        self,
        config: HexPlaneConfig,
        times: int,
        operators: Operators,
        generator: torch.Generator,
    ) -> None:
        """Initialise the planes at random.

        Args:
            config: sizes and weights.
            times: corners of cells along time, the first at time 0 and the last at time 1.
            operators: for products of planes.
            generator: generator on the CPU.
        """
        super().__init__()
        self._config, self._operators = config, operators
        self.features = config.channels * len(config.multipliers)
        sides = [config.resolution * factor for factor in config.multipliers]
        depth = config.channels
        self.space = nn.ParameterList(
            [uniform((3, side, side, depth), *SPACE_START, generator) for side in sides]
        )
        self.time = nn.ParameterList([torch.ones(times, 3, side, depth) for side in sides])

    def grids(self) -> tuple[nn.Parameter, ...]:
        """Space planes [3, r, r, d] and time planes [t, 3, r, d], by resolution."""
        return (*self.space, *self.time)

    def forward(
        self, places: Float[Tensor, "n 3"], time: Float[Tensor, ""]
    ) -> Float[Tensor, "n f"]:
        """The product of six planes at each resolution."""
        lines = [_at(over_time, time) for over_time in self.time]
        return self._operators.plane_product(places, [*self.space], lines, UNIT)

    def regularizers(self) -> Mapping[str, Tensor]:
        """Variation over space, roughness over time, and distance of time planes from 1.

        Each is a mean over the entries of a plane, summed over planes and resolutions.
        """
        config, planes, operators = self._config, len(PLANE_AXES), self._operators
        terms: dict[str, list[Tensor]] = {}
        if config.plane_tv > 0:
            weight = planes * config.plane_tv
            terms["plane_tv"] = [
                operators.squared_differences(plane, (1, 2), 1, weight) for plane in self.space
            ]
        if config.time_smoothness > 0:
            weight = planes * config.time_smoothness
            terms["time_smoothness"] = [
                operators.squared_differences(plane, (0,), 2, weight) for plane in self.time
            ]
        if config.time_l1 > 0:
            weight = planes * config.time_l1
            terms["time_l1"] = [operators.mean_distance(plane, 1.0, weight) for plane in self.time]
        return {name: torch.stack(values).sum() for name, values in terms.items()}


def _at(planes: Float[Tensor, "t g r d"], time: Float[Tensor, ""]) -> Float[Tensor, "g r d"]:
    """Read time planes at one time: a sum over rows with hat weights, two of them above 0."""
    rows = torch.arange(len(planes), device=planes.device)
    hat = (1 - (time.clamp(0, 1) * (len(planes) - 1) - rows).abs()).clamp_min(0)
    return (hat.to(planes) @ planes.flatten(1)).view(planes.shape[1:])
