"""FLIP of a finished model: its mean over the pixels of a view."""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.maths.flip import flip_map, unavailable
from gsfw.core.maths.ssim import masked_mean
from gsfw.studies.tradeoff.finished_model import LeftOut

MOST_VIEWS = 4
"""Number of measured views, spread evenly: a view of 1080p takes five seconds."""


def left_out() -> list[LeftOut]:
    """FLIP where it cannot be measured, with the reason."""
    why = unavailable()
    return [LeftOut("flip", why)] if why else []


def flip(
    rendered: Float[Tensor, "h w 3"],
    target: Float[Tensor, "h w 3"],
    valid: Bool[Tensor, "h w 1"] | None,
) -> float:
    """Mean over the valid pixels, in [0, 1]: 0 for equal images."""
    differences = flip_map(rendered, target, valid)[None]
    return float(masked_mean(differences, None if valid is None else valid.cpu()[None]))
