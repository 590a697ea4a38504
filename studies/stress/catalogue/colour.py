"""Colour: coefficients far out of range, every number of channels, and odd backgrounds."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase, coefficients
from gsfw.studies.stress.catalogue.variants import EVERYTHING, SIZE, ordinary, splat_cases
from gsfw.studies.stress.scene import front_camera, random_splats


def with_sh(value: float) -> Change:
    """Every coefficient this large."""
    return lambda splats: replace(
        splats, colors=Sh(value * torch.ones_like(coefficients(splats)), 1)
    )


def with_channels(count: int) -> Change:
    """So many channels, drawn as they are."""

    def change(splats: Splats) -> Splats:
        shades = torch.rand(len(splats), count, generator=torch.Generator().manual_seed(1))
        return replace(splats, colors=shades.to(splats.means))

    return change


CHANGES: dict[str, Change] = {
    "colour/sh-1e4": with_sh(1e4),
    "colour/negative": with_sh(-1e4),
    "colour/32-channels": with_channels(32),
}

REASONS: dict[str, str] = {}

CHANNELS = (1, 3, 4, 16, 33)


def _channels(count: int) -> Drawing:
    background = torch.linspace(-1, 2, count).requires_grad_()
    settings = replace(EVERYTHING, background=background)
    return Drawing(with_channels(count)(ordinary()), front_camera(*SIZE), settings)


def _background(*values: float) -> Drawing:
    settings = RenderSettings(background=torch.tensor(values).requires_grad_())
    return Drawing(ordinary(), front_camera(*SIZE), settings)


def _degree(degree: int) -> Drawing:
    return Drawing(random_splats(20, degree), front_camera(*SIZE), EVERYTHING)


def _ragged() -> Drawing:
    """Each splat its own number of coefficients, some of none above the constant one."""
    splats = random_splats(20, 3)
    assert isinstance(splats.colors, Sh)
    colors = splats.colors.of_degrees(torch.arange(20) % 4)
    return Drawing(replace(splats, colors=colors), front_camera(*SIZE), EVERYTHING)


def _extra() -> Drawing:
    extra = torch.linspace(-1e4, 1e4, 100).view(20, 5)
    return Drawing(replace(ordinary(), extra=extra), front_camera(*SIZE), EVERYTHING)


COLOUR = (
    *splat_cases(CHANGES, REASONS),
    *(
        StressCase(f"colour/channels-{count}", lambda count=count: _channels(count))  # type: ignore[misc]
        for count in CHANNELS
    ),
    *(
        StressCase(f"colour/degree-{degree}", lambda degree=degree: _degree(degree))  # type: ignore[misc]
        for degree in range(5)
    ),
    StressCase("colour/ragged", _ragged),
    StressCase("colour/extra-1e4", _extra),
    StressCase("colour/background-outside", lambda: _background(-5.0, 0.5, 7.0)),
    StressCase("colour/background-1e6", lambda: _background(-1e6, 1e6, 0.0)),
)
"""All cases of this section."""
