"""Up axis: which way is up in the scene, for drawings and for angles around a thing."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gsfw.core.maths.axes import known_axis
from gsfw.core.scene import Scene
from gsfw.preparation.check.viewpoints import Viewpoints

AGREE = 0.7
"""Length of the mean of the cameras' up vectors from which on they say where up is."""
LEVEL = 0.35
"""Sine of the angle by which most cameras are held level at most: 20 degrees."""
SPREAD = 0.1
"""Second eigenvalue of the cameras' right vectors, in parts of the first, from which on they span
a plane: 0.1 are 20 degrees to each side."""
TILTED = 10.0
"""Degrees from what the data says beyond which cameras that are held level know better."""
ROUNDS = 10
"""Rounds of reweighting, after which the axis hardly moves."""


def up_axis(scene: Scene, viewpoints: Viewpoints) -> tuple[Float[np.ndarray, " 3"], str]:
    """A unit vector in the scene, and where it comes from."""
    poses = viewpoints.poses[viewpoints.places]
    held, told = _level_axis(poses), _told_axis(scene)
    # A reconstruction calls an axis up that is only that of its first photo.
    if told is not None and (held is None or held @ told > np.cos(np.radians(TILTED))):
        return told, "up as the data says"
    if held is not None:
        return held, "up as the cameras are held"
    mean = -poses[:, 1, :3].mean(0)
    length = float(np.linalg.norm(mean))
    if length > AGREE:
        return mean / length, "up as the cameras are held"
    offsets = viewpoints.centers[viewpoints.places]
    offsets = np.concatenate([offsets - offsets.mean(0), 1e-9 * np.eye(3)])
    axis = np.linalg.svd(offsets, full_matrices=False)[2][2]
    return axis * (1.0 if axis @ mean >= 0 else -1.0), "up across the cameras"


def _told_axis(scene: Scene) -> Float[np.ndarray, " 3"] | None:
    world = known_axis(scene.up)
    if world is None:
        return None
    return scene.world_from_scene.rotation.numpy().T @ world.numpy()


def _level_axis(poses: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, " 3"] | None:
    """The axis across all right vectors; ``None`` if these lie along one line, or in no plane.

    People hold cameras level whatever they aim at, so that this is up also where all look down.
    Least absolute sines: photos that were taken upright and are stored on their side count little.
    """
    rights, ups = poses[:, 0, :3], -poses[:, 1, :3]
    weights = np.ones(len(rights))
    for _ in range(ROUNDS):
        values, vectors = np.linalg.eigh((weights[:, None] * rights).T @ rights)
        weights = 1 / np.maximum(np.abs(rights @ vectors[:, 0]), 0.01)
    axis = vectors[:, 0]
    level = np.median(np.abs(rights @ axis)) < LEVEL
    if values[1] < SPREAD * values[2] or not level:
        return None
    axis = axis * (1.0 if np.median(ups @ axis) >= 0 else -1.0)
    return axis / np.linalg.norm(axis)
