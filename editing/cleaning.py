"""Cleaning: splats that no renderer shows, or that only faults of training explain."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from jaxtyping import Bool
from torch import Tensor

from gsfw.core.maths.inner_box import inner_box
from gsfw.core.numerics import FAINTEST, QUATERNION_MIN_NORM
from gsfw.core.splats import Splats

THINNEST = 1e-6
"""Middle axis, relative to the longest, below which a splat is a line without an area."""
HUGE = 0.5
"""Longest axis (standard deviation) of a needle, in sizes of the scene."""
NEEDLE = 20.0
"""Longest axis of a needle, relative to its middle one."""


def not_finite(splats: Splats) -> Bool[Tensor, " n"]:
    """True for rows with any value that is not finite in float32, as files hold it."""
    return ~splats.held_by_float32()


def invisible(splats: Splats) -> Bool[Tensor, " n"]:
    """True for splats too faint for any renderer: alphas below 1/255 are skipped."""
    return splats.opacities < FAINTEST


def degenerate(splats: Splats) -> Bool[Tensor, " n"]:
    """True for splats without an area from any side, or without a rotation."""
    assert splats.scales is not None
    assert splats.quats is not None
    ordered = splats.scales.sort(dim=1).values
    flat = ordered[:, 1] <= THINNEST * ordered[:, 2]
    return flat | (splats.quats.norm(dim=1) < QUATERNION_MIN_NORM)


def needles(splats: Splats) -> Bool[Tensor, " n"]:
    """True for thin splats that are as long as the scene: spikes that cross every other view."""
    assert splats.scales is not None
    ordered = splats.scales.sort(dim=1).values
    is_thin = ordered[:, 2] > NEEDLE * ordered[:, 1]
    return is_thin & (ordered[:, 2] > HUGE * scene_size(splats))


def scene_size(splats: Splats) -> float:
    """Diagonal of the box around nearly all splats; 0 without splats."""
    means = splats.means[splats.means.isfinite().all(1)]
    if not len(means):
        return 0.0
    low, high = inner_box(means)
    return float((high - low).norm())


FAULTS: Mapping[str, Callable[[Splats], Bool[Tensor, " n"]]] = {
    "not_finite": not_finite,
    "invisible": invisible,
    "degenerate": degenerate,
    "needles": needles,
}
"""Kinds of splats that cleaning removes, by name."""
