"""Pose conventions: other readings of the poses of a file, and the one that matches agree with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from gsfw.preparation.check.pose_agreement import Rig, agreement
from gsfw.preparation.check.view_matches import ViewMatches

SURE, WRONG = 0.7, 0.4
"""Mean agreement from which on another reading is right, and up to which the present one is wrong:
0.93 to 0.98 for the shared captures as they are, 0.73 for one that moves, at most 0.12 with
inverted or mirrored poses."""
FEWEST_PAIRS = 10
"""Pairs of images below which nothing is said."""


@dataclass(frozen=True)
class Reading:
    """A way to read poses."""

    kind: str
    """The fault of a file that has to be read so; empty for the usual reading."""
    axes: tuple[int, ...]
    """Signs of the camera's x, y and z axes, against the usual reading."""
    agreement: float
    """Mean part of the matches that agree with it."""

    @property
    def mirrors(self) -> bool:
        """True if an odd number of axes is turned round."""
        return self.axes[0] * self.axes[1] * self.axes[2] < 0


def readings(matches: ViewMatches, rig: Rig) -> tuple[Reading, ...]:
    """All readings, the one that most matches agree with first; the usual one before equals."""
    found = []
    for kind, read in _variants(rig):
        for axes in product((1, -1), repeat=3):
            signs = np.array(axes, np.float64)
            turned = replace(
                read,
                rotations=signs[:, None] * read.rotations,
                translations=signs * read.translations,
            )
            found.append(Reading(kind, axes, float(agreement(matches, turned).mean())))
    return tuple(sorted(found, key=lambda reading: -reading.agreement))


def _variants(rig: Rig) -> Iterator[tuple[str, Rig]]:
    turns, shifts = rig.rotations, rig.translations
    back = turns.transpose(0, 2, 1)
    centers = -np.einsum("vij,vj->vi", back, shifts)
    yield "", rig
    yield "inverted", replace(rig, rotations=back, translations=centers)
    yield "rotations transposed", replace(rig, rotations=back)
    kept = -np.einsum("vij,vj->vi", back, centers)
    yield "rotations transposed", replace(rig, rotations=back, translations=kept)
    swapped = -np.einsum("vij,vj->vi", turns, shifts)
    yield "positions for translations", replace(rig, translations=swapped)


def better_reading(matches: ViewMatches, rig: Rig) -> Reading | None:
    """The right reading where it is surely another than the usual one; else ``None``."""
    if len(matches.pairs) < FEWEST_PAIRS:
        return None
    ranked = readings(matches, rig)
    usual = next(r for r in ranked if not r.kind and r.axes == (1, 1, 1))
    best = ranked[0]
    return best if best.agreement >= SURE and usual.agreement <= WRONG else None
