"""Cameras of other programs: where they see the points of a small capture, by their formulas."""

from collections.abc import Callable

import numpy as np

from gsfw.datamanagers.capture import Capture
from support.small_captures import SmallCapture

Formula = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From x / z and y / z to pixels counted from the image's corner."""


def pixel_error(data: Capture, capture: SmallCapture, formula: Formula) -> float:
    """Pixels between where loaded lenses see the points and where a formula says; the worst."""
    worst = 0.0
    for frame in data.recording.frames:
        pose = capture.poses[capture.names.index(frame.name)]
        local = capture.points @ pose[:3, :3].T + pose[:3, 3]
        wanted = np.stack(formula(local[:, 0] / local[:, 2], local[:, 1] / local[:, 2]), axis=1)
        placed = frame.world_to_camera.numpy()
        local = capture.points @ placed[:3, :3].T + placed[:3, 3]
        found = frame.lens.project(local[:, :2] / local[:, 2:])
        worst = max(worst, float(np.abs(found - wanted).max()))
    return worst


def brown(x, y, k, on_squares=(0.0, 0.0)):
    """Brown's distortion; ``on_squares`` are the factors of r^2 + 2 x^2 and of r^2 + 2 y^2."""
    r2 = x**2 + y**2
    radial = 1 + sum(value * r2**power for power, value in enumerate(k, 1))
    a, b = on_squares
    return (
        x * radial + a * (r2 + 2 * x**2) + 2 * b * x * y,
        y * radial + b * (r2 + 2 * y**2) + 2 * a * x * y,
    )


def equidistant(x, y):
    """x and y of the fisheye r = theta."""
    r = np.hypot(x, y)
    return x * np.arctan(r) / r, y * np.arctan(r) / r


def undistorted_error(data: Capture, capture: SmallCapture) -> float:
    """Pixels between where the loaded cameras of undistorted images see points and a lens does.

    The lens's pixels are led through the undistortion that images are warped with.
    """
    worst = 0.0
    for frame in data.recording.frames:
        found = frame.undistortion(data._rule)
        placed = frame.world_to_camera.numpy()
        local = capture.points @ placed[:3, :3].T + placed[:3, 3]
        slopes = local[:, :2] / local[:, 2:]
        looked, _ = found.look(found.target.project(slopes))
        worst = max(worst, float(np.abs(looked - frame.lens.project(slopes)).max()))
    return worst
