"""Ground: the plane that blocks are cut in, from the up direction, the points and the cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

FLAT = 0.25
"""Smallest variance over the middle one, up to which points lie along a plane: half the length."""
TRIMMED = 0.01
"""Part of the points on each side of an axis that do not count: they float far away."""


@dataclass(frozen=True)
class Ground:
    """A frame with two axes along the ground and one upwards, in the world of the data.

    All in float64: positions relative to the origin keep the digits of georeferenced coordinates.
    """

    origin: Float64[np.ndarray, " 3"]
    axes: Float64[np.ndarray, "3 3"]
    """Orthonormal, in rows: the first and the second axis of the ground, and up."""

    def places(self, points: Float64[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 2"]:
        """Places of points of the world along the two axes of the ground."""
        # By coordinates and not by a matrix product, whose bits depend on the number of rows.
        offsets = points - self.origin
        first, second = (
            offsets[:, 0] * axis[0] + offsets[:, 1] * axis[1] + offsets[:, 2] * axis[2]
            for axis in self.axes[:2]
        )
        return np.stack([first, second], axis=1)


def find_ground(
    points: Float64[np.ndarray, "p 3"],
    poses: Float64[np.ndarray, "v 4 4"],
    stated: Float64[np.ndarray, " 3"] | None,
) -> Ground:
    """The ground of a scene.

    Up is across the plane that the points lie along, on the side of the cameras. Where they lie
    along none, it is the direction that the data states, or else as the cameras are held: what
    formats state is a convention of theirs ("-y" in any COLMAP model), not a measurement. The first
    axis is the longest one of the points on the ground.

    Args:
        points: of the world; at least one.
        poses: world to camera, OpenCV axes.
        stated: a unit vector of the world; ``None`` when unknown.
    """
    inner = points[within(points)]
    origin = np.median(inner, axis=0)
    offsets = inner - origin
    values, vectors = np.linalg.eigh(offsets.T @ offsets)
    if values[0] <= FLAT * values[1]:
        centers = -np.einsum("vji,vj->vi", poses[:, :3, :3], poses[:, :3, 3])
        above = vectors[:, 0] @ (centers - origin).mean(axis=0) >= 0
        up = vectors[:, 0] if above else -vectors[:, 0]
    elif stated is not None:
        up = stated
    else:
        held = -poses[:, 1, :3].mean(axis=0)
        up = held / max(float(np.linalg.norm(held)), 1e-12)
    flat = np.eye(3) - np.outer(up, up)
    first = np.linalg.eigh(flat @ (offsets.T @ offsets) @ flat)[1][:, 2]
    first = flat @ first
    first /= np.linalg.norm(first)
    largest = np.abs(first).argmax()
    first = first if first[largest] > 0 else -first
    return Ground(origin, np.stack([first, np.cross(up, first), up]))


def within(points: Float64[np.ndarray, "p d"]) -> Bool[np.ndarray, " p"]:
    """True for points that are not among the outermost ``TRIMMED`` of any axis."""
    low, high = np.quantile(points, [TRIMMED, 1 - TRIMMED], axis=0)
    found = ((points >= low) & (points <= high)).all(axis=1)
    return found if found.any() else np.ones(len(points), bool)
