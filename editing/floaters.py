"""Floaters: splats that have few neighbours, unlike nearly all others.

Statistical outlier removal (Rusu et al. 2008, as in the Point Cloud Library) compares each point's
mean distance from its neighbours with that of all points. Distances in a capture span decades, from
the subject to the background, so that logarithms are compared here, by median and median deviation.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.operators import Operators

NEIGHBORS = 16
"""Number of neighbours."""
NORMAL = 1.4826
"""Standard deviation of a normal distribution in median absolute deviations."""
SMALLEST = 1e-12
"""Distance of splats in one place."""
LEAST_SPREAD = 0.05
"""Least spread of the logarithms: on a regular grid distances are all the same, and a splat at
slightly more than that floats no less."""


def floating(means: Float[Tensor, "n 3"], deviations: float) -> Bool[Tensor, " n"]:
    """True for splats whose neighbours are much farther away than those of nearly all others.

    Args:
        means: centres.
        deviations: how many standard deviations of the logarithm above the median.
    """
    count = min(NEIGHBORS, len(means) - 1)
    if count < 1:
        return torch.zeros(len(means), dtype=torch.bool)
    points = (means - means.median(0).values).float().cpu()
    distances = Operators().neighbor_distances(points, count).double().mean(1)
    logarithms = distances.clamp_min(SMALLEST).log()
    middle = logarithms.median()
    spread = max(float((logarithms - middle).abs().median()) * NORMAL, LEAST_SPREAD)
    return (logarithms > middle + deviations * spread).to(means.device)
