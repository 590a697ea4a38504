"""Shape: splats far too small, far too large, flat, thin, or of no size at all."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase
from gsfw.studies.stress.catalogue.variants import SMOOTH, splat_cases
from gsfw.studies.stress.scene import front_camera


def scaled(*factors: float) -> Change:
    """Scales times these."""

    def change(splats: Splats) -> Splats:
        assert splats.scales is not None
        return replace(splats, scales=splats.scales * splats.scales.new_tensor(factors))

    return change


def covariances(*variances: float) -> Change:
    """Covariances with these eigenvalues, along random axes."""

    def change(splats: Splats) -> Splats:
        drawn = torch.randn(len(splats), 3, 3, generator=torch.Generator().manual_seed(0))
        axes = torch.linalg.qr(drawn).Q
        made = (axes @ torch.diag(torch.tensor(variances)) @ axes.transpose(1, 2)).to(splats.means)
        return replace(splats, quats=None, scales=None, covariances=made)

    return change


CHANGES: dict[str, Change] = {
    "shape/scales-1e-10": scaled(1e-10, 1e-10, 1e-10),
    "shape/scales-1e-7": scaled(1e-7, 1e-7, 1e-7),
    "shape/scales-1e3": scaled(1e3, 1e3, 1e3),
    "shape/scales-1e6": scaled(1e6, 1e6, 1e6),
    "shape/scales-1e30": scaled(1e30, 1e30, 1e30),
    "shape/needles": scaled(1e3, 1e-3, 1e-3),
    "shape/discs": scaled(1e3, 1e3, 1e-3),
    "shape/two-zero-scales": scaled(1.0, 0.0, 0.0),
    "shape/one-zero-scale": scaled(1.0, 1.0, 0.0),
    "shape/zero-scales": scaled(0.0, 0.0, 0.0),
    "shape/zero-covariances": covariances(0.0, 0.0, 0.0),
    "shape/needle-covariances": covariances(1.0, 1e-6, 1e-6),
    "shape/covariances-not-positive": covariances(0.1, 0.1, -1e-6),
    "shape/covariances-1e12": covariances(1e12, 1e12, 1e12),
}

FLAT = (
    "a splat much larger than the image is the same all over it: what is left of the gradients "
    "by rotation and scale is a rest of cancellations"
)
ENTRIES = (
    "the entries of a covariance hold its small axis only as a difference of numbers 1e6 times "
    "as large"
)

REASONS = {
    "shape/scales-1e3": FLAT,
    "shape/scales-1e6": FLAT,
    "shape/scales-1e30": FLAT,
    "shape/discs": FLAT,
    "shape/covariances-1e12": FLAT,
    "shape/needle-covariances": ENTRIES,
}


def one_needle(settings: RenderSettings) -> Drawing:
    """Aspect 1e6 at 45 degrees: with the published determinant a c - b^2 it is off by 0.4."""
    half = math.pi / 8
    splats = Splats(
        means=torch.zeros(1, 3),
        opacities=torch.ones(1),
        colors=torch.ones(1, 1),
        quats=torch.tensor([[math.cos(half), 0.0, 0.0, math.sin(half)]]),
        scales=torch.tensor([[1e3, 1e-3, 1e-3]]),
    )
    return Drawing(splats, front_camera(64, 64), settings)


NEEDLE = "the projected determinant is a difference of numbers 1e12 times as large as itself"

SHAPE = (
    *splat_cases(CHANGES, REASONS),
    StressCase("shape/one-needle", lambda: one_needle(RenderSettings()), conditioning=NEEDLE),
    StressCase("shape/one-needle/no-cut-offs", lambda: one_needle(SMOOTH), conditioning=NEEDLE),
    StressCase(
        "shape/one-needle/antialias-floor",
        lambda: one_needle(RenderSettings(antialias=True, profile=DEFAULT)),
        conditioning=NEEDLE,
    ),
)
"""All cases of this section."""
