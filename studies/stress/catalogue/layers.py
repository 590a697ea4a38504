"""Layers: very many splats over one pixel, and a transmittance that ends at the stop."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.studies.stress.case import Drawing, StressCase
from gsfw.studies.stress.scene import front_camera, layers

MANY = 100_000

CUT_OFF = RenderSettings(statistics=frozenset(Statistic))
SMOOTH = replace(CUT_OFF, profile=DEFAULT.without_cutoffs())


def _piled(count: int, opacity: float, settings: RenderSettings = CUT_OFF) -> Drawing:
    return Drawing(layers(count, opacity), front_camera(1, 1), settings)


def _at_the_stop(*opacities: float) -> Drawing:
    """Layers that leave about as much as the stop, and one behind them."""
    splats = layers(len(opacities) + 1, 0.5, channels=3)
    assert splats.scales is not None
    splats = replace(splats, opacities=torch.tensor([*opacities, 0.5]), scales=4.0 * splats.scales)
    return Drawing(splats, front_camera(9, 7), CUT_OFF)


SUM = "a product of thousands of factors gathers a rounding of each, and so does plain float32"

# (1 - 0.99) squared is the stop itself: after one layer of 0.99 another is drawn, or is not.
LAYERS = (
    StressCase("layers/100000-of-1-in-254", lambda: _piled(MANY, 1 / 254), conditioning=SUM),
    StressCase("layers/100000-of-0.99", lambda: _piled(MANY, 0.99), at_a_cut_off=1),
    StressCase("layers/100000-of-0.5", lambda: _piled(MANY, 0.5)),
    StressCase(
        "layers/5000-seen-through",
        lambda: _piled(5000, 2e-4, SMOOTH),
        conditioning=SUM,
    ),
    StressCase("layers/above-the-stop", lambda: _at_the_stop(0.9, 0.9, 0.95, 0.75)),
    StressCase("layers/below-the-stop", lambda: _at_the_stop(0.9, 0.9, 0.95, 0.85)),
    StressCase("layers/at-the-stop", lambda: _at_the_stop(0.9, 0.9, 0.99), at_a_cut_off=1),
)
"""All cases of this section."""
