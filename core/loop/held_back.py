"""HeldBack: training views that a run does not train on until its last part, to judge itself by.

They are training views: the held-out views of the evaluation are never looked at. Their place in
the order of the sampler is taken by a neighbour of the same time, so that samplers, their state and
their schedules are those of any other run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gsfw.core.datamanager import Views, spread

LEAST_LEFT = 3
"""Views that are left to train on for each view that is held back, at least."""


class HeldBack:
    """Training views that are held back, and those that replace them."""

    def __init__(self, views: Views, count: int) -> None:
        """Choose views that are spread evenly.

        Args:
            views: the training views.
            count: number of views to hold back; fewer where others of their time are missing.
        """
        number = len(views)
        count = min(count, number // (1 + LEAST_LEFT))
        nearest: dict[int, int] = {}
        for view in spread(range(number), count) if count else ():
            # Views of a step have one time and, in a batch, one size.
            alike = [
                other
                for other in range(number)
                if other != view and other not in nearest and len(views.groups((view, other))) == 1
            ]
            if alike:
                nearest[view] = min(alike, key=lambda other: abs(other - view))
        self._substitutes = {view: _free(view, nearest) for view in nearest}

    @property
    def views(self) -> tuple[int, ...]:
        """Indices of the views that are held back."""
        return tuple(self._substitutes)

    def replace(self, views: Sequence[int]) -> tuple[int, ...]:
        """The views to train on in a step for which the sampler chose ``views``."""
        if self._substitutes.keys().isdisjoint(views):
            return tuple(views)
        return tuple(dict.fromkeys(self._substitutes.get(view, view) for view in views))


def _free(view: int, nearest: Mapping[int, int]) -> int:
    """The first view in a chain of neighbours that is not held back itself."""
    while view in nearest:
        view = nearest[view]
    return view
