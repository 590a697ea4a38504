"""The box of nearly all Gaussians, without a sky and stray ones."""

from __future__ import annotations

import torch
from jaxtyping import Float, Float64
from torch import Tensor

NEAR_SHARE = 0.8
"""Share of the Gaussians that a sky leaves to the scene, at least."""
FAR = 4.0
"""A sky begins beyond this many distances within which that share lies, from the median position.
Nothing else does, unless the scene is one dense place with long arms."""
OUTSIDE = 0.02
"""Share of the others that is left out at each side of each axis."""
SAMPLE = 100_000
"""Gaussians that are enough to find the box."""


def inner_box(means: Float[Tensor, "n 3"]) -> Float64[Tensor, "2 3"]:
    """The lowest and the highest corner.

    Args:
        means: finite positions, at least one.
    """
    sample = means.detach().cpu().double()[:: len(means) // SAMPLE + 1]
    distances = (sample - sample.median(dim=0).values).norm(dim=1)
    spread = distances.quantile(NEAR_SHARE)
    if spread > 0:
        sample = sample[distances <= FAR * spread]
    return torch.quantile(sample, torch.tensor([OUTSIDE, 1 - OUTSIDE]).double(), dim=0)
