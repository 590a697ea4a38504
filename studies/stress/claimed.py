"""Claimed: what is left of a case for a backend that does not claim all that the case asks for.

A case asks for everything at once: every image, statistic and gradient, with antialiasing. Its
extreme has nothing to do with most of these. So a backend is judged on the rest of a case, without
the outputs that it does not claim; only a case that is about such a feature is not for it.
"""

from __future__ import annotations

from dataclasses import replace

from gsfw.core.capabilities import Capabilities, Feature
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.render_settings import STATISTIC_FEATURES, Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats
from gsfw.studies.stress.case import Drawing, StressCase

INCIDENTAL = frozenset(
    {
        Feature.GRADIENT,
        Feature.POSE_GRADIENT,
        Feature.SH,
        Feature.DEPTH,
        Feature.ANTIALIAS,
        *STATISTIC_FEATURES.values(),
    }
)
"""Features that a case can do without, unless it is about them."""

BY_BACKWARD = frozenset({Statistic.SCREEN_GRADIENT, Statistic.ABSGRAD})
"""Statistics that the backward pass writes."""


def left_out(case: StressCase, drawing: Drawing, able: Capabilities) -> frozenset[Feature]:
    """Features of a case's input that a backend does not claim, and that the case can do without.

    Args:
        case: the case.
        drawing: its input.
        able: the abilities of the backend.
    """
    missing = drawing.needs().features - able.features
    return frozenset(missing & INCIDENTAL - case.about)


def without(drawing: Drawing, features: frozenset[Feature]) -> Drawing:
    """The same input without some features."""
    if not features:
        return drawing
    gradients = drawing.gradients - features
    if Feature.GRADIENT in features:
        gradients = frozenset()
    settings = _settings_without(drawing.settings, features, bool(gradients))
    splats = drawing.splats
    if Feature.SH in features:
        splats = _with_plain_colors(splats)
    return replace(drawing, splats=splats, settings=settings, gradients=gradients)


def _settings_without(
    settings: RenderSettings, features: frozenset[Feature], goes_back: bool
) -> RenderSettings:
    statistics = {item for item in settings.statistics if STATISTIC_FEATURES[item] not in features}
    return replace(
        settings,
        antialias=settings.antialias and Feature.ANTIALIAS not in features,
        depth=Depth.NONE if Feature.DEPTH in features else settings.depth,
        statistics=frozenset(statistics if goes_back else statistics - BY_BACKWARD),
    )


def _with_plain_colors(splats: Splats) -> Splats:
    """Splats of one colour each: that of their constant coefficient."""
    colors = splats.colors
    if not isinstance(colors, Sh) or colors.offsets is not None:
        return splats
    return replace(splats, colors=dc_to_rgb(colors.coefficients[:, 0]))
