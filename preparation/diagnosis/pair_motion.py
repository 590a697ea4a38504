"""Pair motion: tells a camera that only turned from one that moved along a plane.

A homography explains the matches of both. That of a turn is K R K^-1 (Hartley and Zisserman,
"Multiple View Geometry", 8.4). The homography of a plane is R + t n^T / d, and no focal length
makes a rotation of it, except in the limit of a very long one: a step sideways before a wall then
looks like a turn, as both shift the image and nothing more. Such a pair does not count as a turn.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

SHORTEST, LONGEST = 0.35, 4.0
"""Focal lengths that are tried, in longer sides: from 110 to 14 degrees across."""
TRIED, ROUNDS = 9, 3
"""Focal lengths of a round, and rounds, each between the neighbours of the last best one: the final
ones are 2 % apart."""
SLACK, PRECISION = 3.0, 5e-4
"""A turn explains the matches if its median error is at most so many times the homography's, plus
half a pixel of 1000."""
BENT = 3.0
"""Errors of the best turn that the best rigid motion of the image must exceed: without perspective
in the motion, a turn cannot be told from a step sideways. By these limits, of simulated pairs with
noise of half a pixel of 1000 and fields of view of 30 to 90 degrees, 385 of 396 of turning cameras
count as turns, and 33 of 3,071 of cameras that move along a plane. None of 130 pairs of fox does
that a homography explains."""
SAMPLED = 100
"""Most matches of a pair that are used."""

Places = Float[np.ndarray, "n 2"]


def only_turned(first: Places, second: Places, homography: Float[np.ndarray, "3 3"] | None) -> bool:
    """True if the matches of two images show that the camera turned, and did not move.

    Args:
        first: places of the matches in the first image, from its centre, in longer sides.
        second: the same of the second image.
        homography: from the first places to the second ones.
    """
    if homography is None:
        return False
    step = -(-len(first) // SAMPLED)
    first, second = first[::step], second[::step]
    error = turn_error(first, second)
    explained = _median_error(_homogeneous(first) @ homography.T, second)
    return bool(
        error < SLACK * explained + PRECISION and _rigid_error(first, second) > BENT * error
    )


def turn_error(first: Places, second: Places) -> float:
    """Median error of the best turn, over all focal lengths; in the units of the places."""
    low, high = SHORTEST, LONGEST
    for _ in range(ROUNDS):
        focals = np.geomspace(low, high, TRIED)
        errors = _turn_errors(first, second, focals)
        best = int(errors.argmin())
        low, high = focals[max(best - 1, 0)], focals[min(best + 1, TRIED - 1)]
    return float(errors[best])


def _turn_errors(
    first: Places, second: Places, focals: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " f"]:
    """Median error of the best turn with each focal length."""
    ours, theirs = (_homogeneous(places / focals[:, None, None]) for places in (first, second))
    weights = 1 / np.linalg.norm(ours, axis=2) / np.linalg.norm(theirs, axis=2)
    u, _, vt = np.linalg.svd((theirs * weights[..., None]).transpose(0, 2, 1) @ ours)
    # The nearest rotation (Kabsch 1976), not a reflection.
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return focals * _median_error(ours @ (u @ vt).transpose(0, 2, 1), theirs[..., :2])


def _rigid_error(first: Places, second: Places) -> float:
    """Median error of the best rotation and shift within the image."""
    ours, theirs = first - first.mean(0), second - second.mean(0)
    u, _, vt = np.linalg.svd(theirs.T @ ours)
    u[:, 1] *= np.linalg.det(u @ vt)
    return float(np.median(np.linalg.norm(ours @ (u @ vt).T - theirs, axis=1)))


def _median_error(
    seen: Float[np.ndarray, "*many n 3"], places: Float[np.ndarray, "*many n 2"]
) -> Float[np.ndarray, "*many"]:
    """Median distance of homogeneous points from where they were seen."""
    depths = seen[..., 2:]
    safe = np.where(np.abs(depths) > 1e-9, depths, 1e-9)
    return np.asarray(np.median(np.linalg.norm(seen[..., :2] / safe - places, axis=-1), axis=-1))


def _homogeneous(places: Float[np.ndarray, "*many 2"]) -> Float[np.ndarray, "*many 3"]:
    return np.concatenate([places, np.ones_like(places[..., :1])], -1)
