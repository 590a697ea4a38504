"""Smallest three: a unit quaternion as three of its components and the index of the fourth.

The largest component follows from the others, which lie within 1 / sqrt(2) of 0. Every compressed
format of splats stores rotations so, each with its own order of components and number of bits.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

BOUND = 1 / np.sqrt(2)
"""Largest magnitude of a component that is not the largest."""
OTHERS = np.array([[other for other in range(4) if other != largest] for largest in range(4)])
"""The indices of the other components, by that of the largest."""


def smallest_three(
    quats: Float[np.ndarray, "n 4"],
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Index of the component of largest magnitude, and the others in their order.

    The signs are those of the quaternion whose largest component is positive: the same rotation.
    """
    largest, signs = _largest(quats)
    rows = np.arange(len(quats))
    return largest, quats[rows[:, None], OTHERS[largest]] * signs[:, None]


def signs_in_smallest_three(quats: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """1, or -1 for the quaternions that ``smallest_three`` gives back with the other sign.

    Other precisions break ties between the components in other ways: ask with the same numbers.
    """
    return _largest(quats)[1]


def _largest(
    quats: Float[np.ndarray, "n 4"],
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Index and sign of the component of largest magnitude."""
    largest = np.abs(quats).argmax(axis=1)
    found = quats[np.arange(len(quats)), largest]
    return largest, np.where(found < 0, -1, 1).astype(quats.dtype)


def from_smallest_three(
    largest: Int[np.ndarray, " n"], three: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 4"]:
    """The unit quaternions; three components that are too long for one are shortened."""
    length = np.sqrt((three * three).sum(axis=1))
    three = three / np.maximum(length, 1)[:, None]
    quats = np.empty((len(three), 4), dtype=three.dtype)
    rows = np.arange(len(three))
    quats[rows[:, None], OTHERS[largest]] = three
    quats[rows, largest] = np.sqrt(np.maximum(1 - (three * three).sum(axis=1), 0))
    return quats
