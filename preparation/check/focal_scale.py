"""Focal scale: a factor of all focal lengths that matches agree with better than with the given."""

from __future__ import annotations

import numpy as np

from gsfw.preparation.check.pose_agreement import Rig, agreement
from gsfw.preparation.check.pose_conventions import FEWEST_PAIRS
from gsfw.preparation.check.view_matches import ViewMatches

FACTORS = np.exp(np.linspace(np.log(0.4), np.log(2.5), 37))
"""In steps of 5 %."""
USUAL = 0.15
"""Factors nearer to 1 than this, as logarithms, are what calibrations differ by."""
RIGHT, TIMES = 0.7, 1.6
"""Mean agreement that a factor has to reach, and how many times that of the given focal lengths:
of fox's matches 97 % agree, of fox with focal lengths 1.5 times as long 21 %. Cameras that all look
at one thing hardly tell: 96 and 93 % of chair's."""


def focal_factor(matches: ViewMatches, rig: Rig) -> float | None:
    """The factor, where it is surely not 1; else ``None``."""
    if len(matches.pairs) < FEWEST_PAIRS:
        return None
    given = float(agreement(matches, rig).mean())
    if given >= RIGHT:
        return None
    shares = [float(agreement(matches, rig.with_focal(factor)).mean()) for factor in FACTORS]
    best = int(np.argmax(shares))
    factor = float(FACTORS[best])
    sure = shares[best] >= max(RIGHT, TIMES * given) and abs(np.log(factor)) > USUAL
    return factor if sure else None
