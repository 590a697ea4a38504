"""Depth: at the camera, behind it, on the near plane, very far, and all the same."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase
from gsfw.studies.stress.catalogue.shape import FLAT, scaled
from gsfw.studies.stress.catalogue.variants import EVERYTHING, SIZE, splat_cases
from gsfw.studies.stress.scene import front_camera, random_splats

DISTANCE = 4.0
"""Of the camera from the origin."""


def moved(*depths: float) -> Change:
    """Splats at these view depths, half of them straight ahead and the others to the side."""

    def change(splats: Splats) -> Splats:
        means, n = splats.means.clone(), len(splats)
        means[:, 2] = means.new_tensor(depths).repeat(n)[:n] - DISTANCE
        means[: n // 2, :2] = 0
        return replace(splats, means=means)

    return change


CHANGES: dict[str, Change] = {
    "depth/at-the-camera": moved(0.0),
    "depth/around-the-camera": moved(-1.0, 0.0, 1e-9, 1e-6, 1e-3, 0.009999, 0.01, 0.02),
    "depth/to-1e9": moved(1e-6, 1.0, 1e3, 1e6, 1e9),
    "depth/equal": moved(4.0),
    "depth/behind": moved(-1e-6, -1.0, -1e3, -1e9),
    "depth/around-the-camera-large": lambda splats: moved(0.0, 1e-6, 1e-3)(
        scaled(1e6, 1e6, 1e6)(splats)
    ),
}

TINY_DEPTH = "gradients by position go with 1 / depth squared, here up to 1e12, and hide all others"

REASONS = {
    "depth/to-1e9": TINY_DEPTH,
    "depth/around-the-camera": TINY_DEPTH,
    "depth/around-the-camera-large": FLAT,
}


def _at_the_near_plane(settings: RenderSettings) -> Drawing:
    """A camera at the origin, so that depths are exact; splats small enough to be seen apart."""
    depths = torch.tensor([-0.5, 0.005, 0.0099, 0.00999, 0.01001, 0.0101, 0.02, 1.0])
    side = torch.linspace(-0.35, 0.35, 8)
    splats = random_splats(8)
    means = torch.stack([side * depths, 0.1 * depths, depths], dim=1)
    scales = depths.abs()[:, None] * torch.tensor([0.03, 0.02, 0.01])
    splats = replace(splats, means=means, scales=scales)
    return Drawing(splats, front_camera(48, 16, distance=0.0), settings)


def _straddling() -> Drawing:
    """Large splats whose centres are on this side of the near plane, or on the other."""
    drawing = _at_the_near_plane(RenderSettings(statistics=frozenset(Statistic)))
    splats = replace(drawing.splats, scales=torch.tensor([[0.02, 0.015, 0.01]]).repeat(8, 1))
    return replace(drawing, splats=splats)


def _thousand_equal() -> Drawing:
    n, generator = 1000, torch.Generator().manual_seed(0)
    splats = Splats(
        means=torch.zeros(n, 3),
        opacities=0.02 * torch.rand(n, generator=generator),
        colors=torch.rand(n, 3, generator=generator),
        quats=torch.ones(n, 4),
        scales=torch.tensor([[0.3, 0.2, 0.1]]).repeat(n, 1),
    )
    return Drawing(splats, front_camera(*SIZE), EVERYTHING)


def _closer_than_float32() -> Drawing:
    """Depths one rounding apart, in the order opposite to that of the rows."""
    n = 64
    depths = [torch.tensor(DISTANCE)]
    for _ in range(n - 1):
        depths.append(depths[-1].nextafter(depths[-1].new_tensor(0.0)))
    means = torch.zeros(n, 3)
    means[:, 2] = torch.stack(depths)
    splats = replace(
        random_splats(n),
        means=means,
        opacities=torch.full((n,), 0.2),
        scales=torch.tensor([[0.5, 0.4, 0.3]]).repeat(n, 1),
    )
    return Drawing(splats, front_camera(*SIZE, distance=0.0), EVERYTHING)


NEAR = RenderSettings(statistics=frozenset(Statistic), depth=Depth.ACCUMULATED)

DEPTH = (
    *splat_cases(CHANGES, REASONS),
    StressCase("depth/near-plane", lambda: _at_the_near_plane(NEAR)),
    StressCase("depth/near-plane/straddling", _straddling),
    StressCase("depth/far-plane", lambda: _at_the_near_plane(replace(NEAR, far=0.5))),
    StressCase("depth/thousand-equal", _thousand_equal),
    StressCase("depth/one-rounding-apart", _closer_than_float32),
)
"""All cases of this section."""
