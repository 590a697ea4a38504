"""Found: what a search for the worst has turned up, kept.

The search is tests/studies/stress/test_search.py: hypothesis chooses a ``Place`` and drives the
error of backend ``cpu`` up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Drawing, StressCase
from gsfw.studies.stress.catalogue.camera import camera_with
from gsfw.studies.stress.scene import front_camera, random_splats

COUNT = 3
SIZE = (16, 12)


@dataclass(frozen=True)
class Place:
    """What three splats are like, and from where they are seen."""

    scale: float
    """Of the longest axis, in scene units."""
    anisotropy: float
    """The longest axis divided by the shortest."""
    depth: float
    opacity: float
    offset: float
    """From the middle of the picture, in halves of it."""
    focal: float
    """In pixels."""
    norm: float
    """Of the quaternions."""


def placed(place: Place, settings: RenderSettings) -> Drawing:
    """The three splats."""
    splats = random_splats(COUNT, 1, seed=5)
    assert splats.quats is not None
    depths = place.depth * torch.tensor([1.0, 1.1, 1.2])
    sides = torch.tensor([[-0.1, 0.05], [0.02, -0.06], [0.09, 0.03]]) + place.offset
    half = 0.5 * SIZE[0] / place.focal
    axes = torch.tensor([1.0, place.anisotropy**-0.5, 1.0 / place.anisotropy])
    made = Splats(
        means=torch.cat([sides * half * depths[:, None], depths[:, None]], dim=1),
        opacities=torch.full((COUNT,), place.opacity),
        colors=splats.colors,
        quats=place.norm * torch.nn.functional.normalize(splats.quats, dim=1),
        scales=place.scale * axes * torch.tensor([[1.0], [0.8], [1.25]]),
    )
    return Drawing(made, camera_with(place.focal)(front_camera(*SIZE, distance=0.0)), settings)


def on_a_cut_off(place: Place) -> int:
    """How many splats any rounding may hide: all, or the second of those that the clamp holds."""
    if place.opacity == DEFAULT.alpha_min:
        return COUNT
    return int(place.opacity >= DEFAULT.alpha_max)


SETTINGS = RenderSettings(near=1e-9)

# Of 3,174 random places, and of those that hypothesis drove further, all that were off by more than
# float32 explains were of these two kinds. In both any rounding decides whether a splat is drawn.
PLACES = {
    # Two layers at the clamp of 0.99 leave (1 - 0.99) squared, which is the stop: after one layer
    # the next is drawn, or is not, and backends of float64 differ in it too.
    "found/clamped-layers": Place(3945.3, 2.3e6, 3.8938, 1.0, 2.076, 4734.5, 8.4e7),
    "found/clamped-layers-near": Place(
        0.00014333, 75086.0, 0.00092704, 0.991, -0.2353, 30678.0, 1e6
    ),
    # Opacities of exactly 1 / 255 are drawn where their centre meets a pixel's, or nowhere.
    "found/opacity-of-the-cut-off": Place(
        13.7946, 14.062, 0.45043, 1 / 255, -1.7706, 2888.4, 5.7e-8
    ),
    "found/needle-of-the-cut-off": Place(
        0.0099943, 3.3e6, 1.2646, 1 / 255, 0.71234, 45308.0, 4.9e10
    ),
}

FOUND = tuple(
    StressCase(name, partial(placed, place, SETTINGS), at_a_cut_off=on_a_cut_off(place))
    for name, place in PLACES.items()
)
"""All cases of this section."""
