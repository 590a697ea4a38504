"""Splats: extreme shapes, rotations, opacities and colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import torch

from gsfw.core.capabilities import Feature
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.studies.stress.case import (
    Change,
    Drawing,
    StressCase,
    coefficients,
    front_camera,
    random_splats,
)
from gsfw.studies.stress.catalogue.variants import EVERYTHING, SIZE, SMOOTH, ordinary, splat_cases


def scaled(*factors: float) -> Change:
    """Multiply the scales."""

    def change(splats: Splats) -> Splats:
        assert splats.scales is not None
        return replace(splats, scales=splats.scales * splats.scales.new_tensor(factors))

    return change


def covariances(*variances: float) -> Change:
    """Set covariances with these eigenvalues, along random axes."""

    def change(splats: Splats) -> Splats:
        drawn = torch.randn(len(splats), 3, 3, generator=torch.Generator().manual_seed(0))
        axes = torch.linalg.qr(drawn).Q
        made = (axes @ torch.diag(torch.tensor(variances)) @ axes.transpose(1, 2)).to(splats.means)
        return replace(splats, quats=None, scales=None, covariances=made)

    return change


SHAPE_CHANGES: dict[str, Change] = {
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
    "a splat much larger than the image is constant on it: the gradients by rotation and scale "
    "are differences of much larger, nearly equal numbers"
)
ENTRIES = "the small axis of a covariance is a difference of entries that are 1e6 times as large"

SHAPE_REASONS = {
    "shape/scales-1e3": FLAT,
    "shape/scales-1e6": FLAT,
    "shape/scales-1e30": FLAT,
    "shape/discs": FLAT,
    "shape/covariances-1e12": FLAT,
    "shape/needle-covariances": ENTRIES,
}


def one_needle(settings: RenderSettings) -> Drawing:
    """Aspect 1e6 at 45 degrees: the published determinant a c - b^2 has an error of 0.4 here."""
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
    *splat_cases(SHAPE_CHANGES, SHAPE_REASONS),
    StressCase("shape/one-needle", lambda: one_needle(RenderSettings()), conditioning=NEEDLE),
    StressCase("shape/one-needle/no-cut-offs", lambda: one_needle(SMOOTH), conditioning=NEEDLE),
    StressCase(
        "shape/one-needle/antialias-floor",
        lambda: one_needle(RenderSettings(antialias=True, profile=DEFAULT)),
        conditioning=NEEDLE,
        about=frozenset({Feature.ANTIALIAS}),
    ),
)
"""All cases of this section."""


def with_quats(*quat: float) -> Change:
    """Set the rotation of all splats to one quaternion."""
    return lambda splats: replace(
        splats, quats=splats.means.new_tensor([quat]).repeat(len(splats), 1)
    )


def times(factor: float) -> Change:
    """Multiply the quaternions."""

    def change(splats: Splats) -> Splats:
        assert splats.quats is not None
        return replace(splats, quats=splats.quats * factor)

    return change


ROTATION_CHANGES: dict[str, Change] = {
    "rotation/zero": with_quats(0.0, 0.0, 0.0, 0.0),
    "rotation/norm-1e-20": with_quats(1e-20, 2e-20, 0.0, 0.0),
    "rotation/norm-1e-11": with_quats(1e-11, 2e-11, 0.0, 0.0),
    "rotation/norm-1e20": with_quats(1e20, 2e20, -1e20, 0.0),
    "rotation/norm-1e37": with_quats(1e37, 2e37, -1e37, 3e37),
    "rotation/norm-100": times(100.0),
    "rotation/antipodal": times(-1.0),
}

ROTATION_REASONS: dict[str, str] = {}


def _with_norms(factors: Sequence[float]) -> Drawing:
    splats = ordinary()
    assert splats.quats is not None
    norms = splats.means.new_tensor(factors).repeat(len(splats))[: len(splats), None]
    return Drawing(replace(splats, quats=splats.quats * norms), front_camera(*SIZE), EVERYTHING)


ROTATION = (
    *splat_cases(ROTATION_CHANGES, ROTATION_REASONS),
    StressCase("rotation/mixed-norms", lambda: _with_norms([1e-11, 1e-3, 1.0, 1e3, 1e20])),
)
"""All cases of this section."""


def with_opacity(value: float) -> Change:
    """Set the opacity of all splats."""
    return lambda splats: replace(splats, opacities=torch.full_like(splats.opacities, value))


def from_logits(*logits: float) -> Change:
    """Set opacities by logits, which saturate at 0 and at 1 in float32."""

    def change(splats: Splats) -> Splats:
        repeated = splats.opacities.new_tensor(logits).repeat(len(splats))[: len(splats)]
        return replace(splats, opacities=repeated.sigmoid())

    return change


OPACITY_CHANGES: dict[str, Change] = {
    "opacity/zero": with_opacity(0.0),
    "opacity/one": with_opacity(1.0),
    "opacity/below-the-cut-off": with_opacity(1 / 256),
    "opacity/above-the-cut-off": with_opacity(1 / 254),
    "opacity/logits-50": from_logits(-50.0, 50.0),
    "opacity/tiny": with_opacity(1e-38),
}

OPACITY_REASONS: dict[str, str] = {}


def _over_everything(settings: RenderSettings) -> Drawing:
    splats = with_opacity(1.0)(scaled(1e6, 1e6, 1e6)(random_splats(1, 0)))
    return Drawing(splats, front_camera(*SIZE), settings)


def _at_the_clamp() -> Drawing:
    """Opacities on both sides of the clamp, whose gradient is zero where it is active."""
    splats, camera = random_splats(8, 0), front_camera(64, 16)
    opacities = torch.tensor([0.985, 0.9895, 0.9899, 0.9901, 0.9905, 0.995, 0.999, 1.0])
    pixels = camera.intrinsics[0, 0, 0] / 4.0
    means = torch.zeros(8, 3)
    # In the centres of pixels, where alpha equals the opacity.
    means[:, 0] = (8.0 * torch.arange(8.0) + 4.5 - 32.0) / pixels
    means[:, 1] = 0.5 / pixels
    scales = torch.tensor([[0.08, 0.06, 0.04]]).repeat(8, 1)
    splats = replace(splats, means=means, opacities=opacities, scales=scales)
    return Drawing(splats, camera, RenderSettings())


OPACITY = (
    *splat_cases(OPACITY_CHANGES, OPACITY_REASONS),
    StressCase("opacity/one-over-everything", lambda: _over_everything(RenderSettings())),
    StressCase(
        "opacity/one-over-everything/no-cut-offs",
        lambda: _over_everything(RenderSettings(profile=DEFAULT.without_cutoffs())),
    ),
    StressCase("opacity/at-the-clamp", _at_the_clamp),
)
"""All cases of this section."""


def with_sh(value: float) -> Change:
    """Set every coefficient."""
    return lambda splats: replace(
        splats, colors=Sh(value * torch.ones_like(coefficients(splats)), 1)
    )


def with_channels(count: int) -> Change:
    """Set plain colours of some channels."""

    def change(splats: Splats) -> Splats:
        shades = torch.rand(len(splats), count, generator=torch.Generator().manual_seed(1))
        return replace(splats, colors=shades.to(splats.means))

    return change


COLOUR_CHANGES: dict[str, Change] = {
    "colour/sh-1e4": with_sh(1e4),
    "colour/negative": with_sh(-1e4),
    "colour/32-channels": with_channels(32),
}

COLOUR_REASONS: dict[str, str] = {}

HARMONICS = frozenset({Feature.SH})
COLOUR_ABOUT = {"colour/sh-1e4": HARMONICS, "colour/negative": HARMONICS}

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
    """Splats with different numbers of coefficients, some with the constant one only."""
    splats = random_splats(20, 3)
    assert isinstance(splats.colors, Sh)
    colors = splats.colors.of_degrees(torch.arange(20) % 4)
    return Drawing(replace(splats, colors=colors), front_camera(*SIZE), EVERYTHING)


def _extra() -> Drawing:
    extra = torch.linspace(-1e4, 1e4, 100).view(20, 5)
    return Drawing(replace(ordinary(), extra=extra), front_camera(*SIZE), EVERYTHING)


COLOUR = (
    *splat_cases(COLOUR_CHANGES, COLOUR_REASONS, about=COLOUR_ABOUT),
    *(
        StressCase(f"colour/channels-{count}", lambda count=count: _channels(count))  # type: ignore[misc]
        for count in CHANNELS
    ),
    *(
        StressCase(f"colour/degree-{degree}", partial(_degree, degree), about=HARMONICS)
        for degree in range(5)
    ),
    StressCase("colour/ragged", _ragged),
    StressCase("colour/extra-1e4", _extra),
    StressCase("colour/background-outside", lambda: _background(-5.0, 0.5, 7.0)),
    StressCase("colour/background-1e6", lambda: _background(-1e6, 1e6, 0.0)),
)
"""All cases of this section."""
