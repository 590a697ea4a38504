"""Rolling shutter: rows that were exposed one after another while the camera moved.

A camera that swings while its rows are read shears each image by another amount. The shears are
fitted to the signed distances of matches from their epipolar lines, which are linear in them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gsfw.preparation.check.pose_agreement import Rig, Triangulation
from gsfw.preparation.check.view_matches import ViewMatches

FEWEST_PAIRS = 15
"""Pairs of images below which nothing is said."""
FAR = 0.02
"""Distances from the line beyond this part of the image are wrong matches."""
ROUNDS = 5
"""Rounds of reweighting, by Huber's weights."""
SHEARED = 0.008
"""Shear from which on it is seen, between the first and the last row, in longer sides of an image:
4 pixels of 480. Fox, plush and chair have 0.002 to 0.003."""
LEFT = 0.7
"""Part of the median distance that shears may leave: 0.92 and more of sound captures, 0.48 to 0.57
of these with 6 to 12 of 480 pixels of shear."""
COMMON = 0.5
"""Length of the mean shear of all images, in parts of the usual one, from which on it is something
else: a focal length that is 10 % off stretches all images alike."""
RIDGE = 1e-2
"""Keeps shears that no match sees at 0."""


def row_shear(matches: ViewMatches, rig: Rig) -> float | None:
    """Usual shear of an image, in its longer side, where rows surely moved; else ``None``."""
    if len(matches.pairs) < FEWEST_PAIRS:
        return None
    ends = matches.pairs[matches.pair]
    found = Triangulation.of(matches, rig)
    sides = rig.sizes.max(1)
    good = np.abs(found.distances) < FAR * sides[ends].mean(1)
    pixels = np.stack([matches.first[:, 1], matches.second[:, 1]], axis=1)
    rows = pixels / rig.sizes[ends, 1] - 0.5
    count = len(rig.sizes)
    system = np.zeros((len(ends), 2 * count))
    for image in (0, 1):
        for axis in (0, 1):
            columns = 2 * ends[:, image] + axis
            system[np.arange(len(ends)), columns] = found.slopes[:, image, axis] * rows[:, image]
    shears, left = _fitted(system[good], found.distances[good])
    before = float(np.median(np.abs(found.distances[good])))
    used = np.unique(matches.pairs)
    relative = shears.reshape(count, 2)[used] / sides[used, None]
    usual = float(np.median(np.linalg.norm(relative, axis=1)))
    common = float(np.linalg.norm(relative.mean(0)))
    sure = left <= LEFT * before and common <= COMMON * usual
    return usual if sure and usual >= SHEARED else None


def _fitted(
    system: Float[np.ndarray, "m k"], distances: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " k"], float]:
    """Shears in pixels, and the median distance that is left."""
    weights = np.ones(len(distances))
    shears = np.zeros(system.shape[1])
    for _ in range(ROUNDS):
        gram = (weights[:, None] * system).T @ system + RIDGE * np.eye(len(shears))
        shears = np.linalg.solve(gram, (weights[:, None] * system).T @ distances)
        left = np.abs(distances - system @ shears)
        weights = np.minimum(1.0, 1.5 * np.median(left) / np.maximum(left, 1e-9))
    return shears, float(np.median(left))
