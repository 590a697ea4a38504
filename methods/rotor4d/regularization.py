"""Regularization of sliced Gaussians: the entropy of opacities, and differences of velocities."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

UNSEEN_SHARE = 0.01
"""Weight of the entropy of rows that a step does not render, relative to that of the others."""
MIN_ENTROPY_OPACITY = 1e-3
"""Opacities this close to 0 or 1 are decided: the entropy has no effect on them."""


@dataclass(frozen=True)
class Regularization:
    """Weights of the regularizers."""

    entropy: float
    velocity: float
    refresh_every: int
    """Steps between searches of neighbours."""


def entropy(opacity_logits: Float[Tensor, " n"], seen: Bool[Tensor, " n"]) -> Float[Tensor, ""]:
    """Mean of -o log o over rendered rows, and, with a small weight, over all others."""
    low, high = MIN_ENTROPY_OPACITY, 1.0 - MIN_ENTROPY_OPACITY
    opacities = opacity_logits.sigmoid().clamp(low, high)
    entropies = -opacities * opacities.log()
    means = [(entropies * part).sum() / part.sum().clamp_min(1) for part in (seen, ~seen)]
    return means[0] + UNSEEN_SHARE * means[1]


def disagreement(
    velocities: Float[Tensor, "r 3"],
    expected: Float[Tensor, "r 3"],
    shown: Bool[Tensor, " r"] | None = None,
) -> Float[Tensor, ""]:
    """Mean of |velocity - expected velocity| (L1) over rows; those of ``shown``, or all."""
    differences = (velocities - expected).abs()
    if shown is None:
        return differences.sum() / max(len(velocities), 1)
    return (differences.sum(1) * shown).sum() / shown.sum().clamp_min(1)
