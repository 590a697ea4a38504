"""Opacity: nothing there, everything hidden, and what lies at the cut-offs."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase
from gsfw.studies.stress.catalogue.shape import scaled
from gsfw.studies.stress.catalogue.variants import SIZE, splat_cases
from gsfw.studies.stress.scene import front_camera, random_splats


def with_opacity(value: float) -> Change:
    """All splats as opaque as this."""
    return lambda splats: replace(splats, opacities=torch.full_like(splats.opacities, value))


def from_logits(*logits: float) -> Change:
    """Opacities as models make them, which saturate at 0 and at 1 in float32."""

    def change(splats: Splats) -> Splats:
        repeated = splats.opacities.new_tensor(logits).repeat(len(splats))[: len(splats)]
        return replace(splats, opacities=repeated.sigmoid())

    return change


CHANGES: dict[str, Change] = {
    "opacity/zero": with_opacity(0.0),
    "opacity/one": with_opacity(1.0),
    "opacity/below-the-cut-off": with_opacity(1 / 256),
    "opacity/above-the-cut-off": with_opacity(1 / 254),
    "opacity/logits-50": from_logits(-50.0, 50.0),
    "opacity/tiny": with_opacity(1e-38),
}

REASONS: dict[str, str] = {}


def _over_everything(settings: RenderSettings) -> Drawing:
    splats = with_opacity(1.0)(scaled(1e6, 1e6, 1e6)(random_splats(1, 0)))
    return Drawing(splats, front_camera(*SIZE), settings)


def _at_the_clamp() -> Drawing:
    """Opacities on both sides of the clamp, whose gradient is zero where it is active."""
    splats, camera = random_splats(8, 0), front_camera(64, 16)
    opacities = torch.tensor([0.985, 0.9895, 0.9899, 0.9901, 0.9905, 0.995, 0.999, 1.0])
    pixels = camera.intrinsics[0, 0, 0] / 4.0
    means = torch.zeros(8, 3)
    # In the centres of pixels, where alpha is opacity itself.
    means[:, 0] = (8.0 * torch.arange(8.0) + 4.5 - 32.0) / pixels
    means[:, 1] = 0.5 / pixels
    scales = torch.tensor([[0.08, 0.06, 0.04]]).repeat(8, 1)
    splats = replace(splats, means=means, opacities=opacities, scales=scales)
    return Drawing(splats, camera, RenderSettings())


OPACITY = (
    *splat_cases(CHANGES, REASONS),
    StressCase("opacity/one-over-everything", lambda: _over_everything(RenderSettings())),
    StressCase(
        "opacity/one-over-everything/no-cut-offs",
        lambda: _over_everything(RenderSettings(profile=DEFAULT.without_cutoffs())),
    ),
    StressCase("opacity/at-the-clamp", _at_the_clamp),
)
"""All cases of this section."""
