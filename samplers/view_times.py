"""The views of each time, for samplers that order views by time."""

from __future__ import annotations

from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError


def views_by_time(views: Views, sampler: str) -> dict[float, list[int]]:
    """Group views by time, in the order of time.

    Args:
        views: the training split.
        sampler: its name in the settings, for messages.

    Raises:
        ConfigError: the views have no times.
    """
    if views.times is None:
        raise ConfigError(
            f"sampler {sampler!r}: the views of this capture have no times.",
            "Use sampler=uniform.",
        )
    found: dict[float, list[int]] = {}
    for view, time in enumerate(views.times):
        found.setdefault(time, []).append(view)
    return dict(sorted(found.items()))
