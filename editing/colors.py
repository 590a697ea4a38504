"""Colours: linear maps of view-dependent colours.

A map of colours M c + b is exact for spherical harmonics: each coefficient is multiplied by M, and
b goes into the constant one. A render then has M of its colours wherever no colour is clamped at 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.splats import Sh, Splats

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in brightness (ITU-R BT.709)."""
MIDDLE = 0.5
"""Brightness that a change of contrast keeps."""


@dataclass(frozen=True)
class ColorMap:
    """A linear map of colours in [0, 1], as images have them: M c + b."""

    matrix: Float64[Tensor, "3 3"]
    offset: Float64[Tensor, " 3"]

    def constant(self, dc: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """The constant coefficients after the map: colours are 0.5 + C0 times them."""
        shift = (0.5 * self.matrix.sum(1) + self.offset - 0.5) / C0
        return dc @ self.matrix.T.to(dc) + shift.to(dc)

    def others(self, coefficients: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """All other coefficients after the map."""
        return coefficients @ self.matrix.T.to(coefficients)


def _diagonal(factors: tuple[float, float, float]) -> ColorMap:
    zeros = torch.zeros(3, dtype=torch.float64)
    return ColorMap(torch.tensor(factors, dtype=torch.float64).diag(), zeros)


def brightness(factor: float) -> ColorMap:
    """Multiply all colours; 1 changes nothing."""
    return _diagonal((factor, factor, factor))


def contrast(factor: float) -> ColorMap:
    """Multiply differences from middle grey; 1 changes nothing."""
    offset = torch.full((3,), MIDDLE * (1 - factor), dtype=torch.float64)
    return replace(brightness(factor), offset=offset)


def saturation(factor: float) -> ColorMap:
    """Multiply differences from the grey of the same brightness; 0 is grey, 1 changes nothing."""
    grey = torch.tensor(LUMA, dtype=torch.float64).expand(3, 3)
    matrix = factor * torch.eye(3, dtype=torch.float64) + (1 - factor) * grey
    return ColorMap(matrix, torch.zeros(3, dtype=torch.float64))


def white_balance(red: float, green: float, blue: float) -> ColorMap:
    """Make a colour grey without a change of its brightness.

    Raises:
        ValueError: a part of the colour is not positive.
    """
    if min(red, green, blue) <= 0:
        raise ValueError(f"the colour {red:g},{green:g},{blue:g}: expected parts above 0")
    grey = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue
    return _diagonal((grey / red, grey / green, grey / blue))


def recolored(splats: Splats, change: ColorMap) -> Splats:
    """Splats after a map of their colours; plain channels must be colours, too."""
    colors = splats.colors
    if not isinstance(colors, Sh):
        return replace(
            splats, colors=colors @ change.matrix.T.to(colors) + change.offset.to(colors)
        )
    dense = colors.dense()
    dc, rest = change.constant(dense[:, :1]), change.others(dense[:, 1:])
    return replace(splats, colors=Sh(torch.cat([dc, rest], dim=1), colors.degree))
