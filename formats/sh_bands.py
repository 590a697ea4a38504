"""SH bands: formats end at different degrees."""

from __future__ import annotations

from dataclasses import replace

from gsfw.core.splats import Sh, Splats


def at_most_degree(splats: Splats, most: int) -> Splats:
    """The splats without SH bands above a degree."""
    colors = splats.colors
    if not isinstance(colors, Sh) or colors.degree <= most:
        return splats
    return replace(splats, colors=replace(colors, degree=most))


def degree_of_splats(splats: Splats) -> int:
    """The active SH degree; 0 for colours that are no SH, which ``stored_parts`` refuses."""
    return splats.colors.degree if isinstance(splats.colors, Sh) else 0
