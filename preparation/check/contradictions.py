"""Contradictions: images whose matches with other images disagree with their cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from gsfw.preparation.check.pose_agreement import Rig, agreement
from gsfw.preparation.check.view_matches import ViewMatches

AGREES, CONTRADICTS = 0.6, 0.3
"""Part of a pair's matches from which on its cameras agree with them, and up to which they do not:
of fox's and plush's pairs 95 % are above 0.62 and 0.91; of cameras turned by 40 degrees none is
above 0.1."""
PARTNERS = 3
"""Other images that an image has to contradict before it is blamed."""
EXCEPTIONS = 0.15
"""Part of its pairs that may agree by chance. Things that look the same from two sides make a sound
camera contradict images of the other side, but it agrees with those beside it."""


@dataclass(frozen=True)
class Contradictions:
    """Views whose cameras do not go with their images."""

    views: Int[np.ndarray, " k"]
    """Views that contradict nearly all images that they share matches with."""
    partners: tuple[tuple[int, ...], ...]
    """Views that each shares most matches with, the first of them."""
    judged: int
    """Views with enough pairs to be judged."""

    @property
    def most(self) -> bool:
        """True if more than half of what was judged contradicts."""
        return 2 * len(self.views) > self.judged >= 2 * PARTNERS

    @staticmethod
    def of(matches: ViewMatches, rig: Rig) -> Contradictions:
        """Find them by a rig."""
        shares = agreement(matches, rig)
        total, good, bad = (
            _per_view(matches, chosen, len(rig.sizes))
            for chosen in (np.ones(len(shares), bool), shares >= AGREES, shares <= CONTRADICTS)
        )
        judged = total >= PARTNERS
        views = np.flatnonzero(judged & (bad >= PARTNERS) & (good <= EXCEPTIONS * total))
        partners = tuple(_partners(matches, int(view)) for view in views)
        return Contradictions(views, partners, int(judged.sum()))


def _per_view(
    matches: ViewMatches, chosen: Bool[np.ndarray, " q"], count: int
) -> Int[np.ndarray, " v"]:
    """Number of the chosen pairs of each view."""
    return np.bincount(matches.pairs[chosen].ravel(), minlength=count)


def _partners(matches: ViewMatches, view: int) -> tuple[int, ...]:
    counts = np.bincount(matches.pair, minlength=len(matches.pairs))
    rows = np.flatnonzero((matches.pairs == view).any(1))
    rows = rows[np.argsort(-counts[rows], kind="stable")][:PARTNERS]
    return tuple(int(matches.pairs[row][matches.pairs[row] != view][0]) for row in rows)


def exchanged_pairs(
    matches: ViewMatches, rig: Rig, views: Int[np.ndarray, " k"]
) -> list[tuple[int, int]]:
    """The two views that agree with all others once they exchange their poses."""
    found: list[tuple[int, int]] = []
    left = [int(view) for view in views]
    while left:
        one = left.pop(0)
        own = matches.where((matches.pairs == one).any(1))
        scores = {other: _mean(agreement(own, rig.exchanged(one, other))) for other in left}
        best = max(scores, key=lambda other: scores[other], default=None)
        if best is not None and scores[best] >= AGREES:
            theirs = matches.where((matches.pairs == best).any(1))
            if _mean(agreement(theirs, rig.exchanged(one, best))) >= AGREES:
                found.append((one, best))
                left.remove(best)
    return found


def _mean(shares: Float[np.ndarray, " q"]) -> float:
    return float(shares.mean()) if len(shares) else 0.0
