"""Initialisation of moving Gaussians: at rest, and present for most of the sequence."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.scene import Scene
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.spacetime.model import MAX_DURATION, TemporalParameters

FRAMES_PER_DURATION = 4
"""Least durations per interval between two times: shorter durations overfit single images, and
nothing constrains them between."""


def min_duration(scene: Scene) -> float:
    """Shortest standard deviation in time, in sequences."""
    return 1.0 / (FRAMES_PER_DURATION * max(scene.num_times - 1, 1))


def at_rest(
    canonical: StaticGaussians,
    centers: Float[Tensor, " n"],
    *,
    duration: float,
    order: int,
    spin: bool,
    features: bool,
) -> TemporalParameters:
    """Initial parameters without motion or rotation; features start as the colour (released code).

    Args:
        canonical: the Gaussians at their temporal centres.
        centers: temporal centres, in [0, 1].
        duration: standard deviation in time, in sequences.
        order: order of the polynomials.
        spin: true if quaternions change.
        features: true if there are features to decode.
    """
    count = canonical.num_rows
    colors = dc_to_rgb(canonical.sh_dc.values.detach()[:, 0])
    return TemporalParameters(
        centers=centers,
        log_durations=torch.full((count,), min(duration, MAX_DURATION)).log(),
        motion=torch.zeros(count, order, 3),
        spins=torch.zeros(count, 4) if spin else None,
        features=colors if features else None,
    )
