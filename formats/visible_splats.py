"""Visible splats: a splat file without those that no renderer shows."""

from __future__ import annotations

from dataclasses import replace

from gsfw.core.exchange import SplatFile
from gsfw.core.numerics import FAINTEST


def without_invisible(content: SplatFile) -> tuple[SplatFile, int]:
    """The same file without splats below the opacity that can reach a pixel, and their number.

    No alpha of a splat exceeds its opacity, and renderers skip every alpha below 1/255
    (``NumericsProfile.alpha_min``), so that images stay the same. A file in which nothing is
    visible keeps everything: formats need at least one splat. Invalid opacities, such as NaN or
    -0.1, stay: formats refuse them with the row.
    """
    opacities = content.splats.opacities
    visible = (~((opacities >= 0) & (opacities < FAINTEST))).nonzero()[:, 0]
    count = len(content.splats) - len(visible)
    if count == 0 or len(visible) == 0:
        return content, 0
    return replace(content, splats=content.splats.take(visible)), count
