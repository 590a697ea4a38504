"""Brown lenses: COLMAP's model for radial terms up to r^8 and two tangential ones.

x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + 2 p1 x y + p2 (r^2 + 2 x^2), and likewise for y
with p1 and p2 exchanged (OpenCV's order). COLMAP's largest model of this kind, FULL_OPENCV, ends at
r^6 but divides by another such polynomial; where k4 is not 0 that quotient is fitted to the four
terms, over what the image shows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from gsfw.core.errors import DataError
from gsfw.datamanagers.lens import Lens

FIT_ERROR = 0.05
"""Most pixels by which the fitted quotient may move a point of the image.

Usual lenses stay below 0.01 at focal lengths of 5000 pixels; estimates are good to some tenths.
"""
SAMPLES = 2000
"""Radii at which the fit is made and checked."""

Radial = tuple[float, float, float, float]
"""k1 to k4."""
Tangential = tuple[float, float]
"""p1 and p2 in OpenCV's order."""


def brown_lens(pinhole: Lens, radial: Radial, tangential: Tangential) -> Lens:
    """The lens of a pinhole with this distortion.

    Raises:
        DataError: a number is not finite, or four radial terms cannot be written as COLMAP's model.
    """
    if not np.isfinite([*radial, *tangential]).all():
        raise DataError(
            f"{pinhole.source}: its distortion {[*radial, *tangential]} is not finite.",
            "Estimate the camera again.",
        )
    k1, k2, k3, k4 = radial
    if not any((*radial, *tangential)):
        return pinhole
    if k3 == k4 == 0:
        return replace(pinhole, model="OPENCV", distortion=(k1, k2, *tangential))
    if k4 == 0:
        over, under = [k1, k2, k3], [0.0, 0.0, 0.0]
    else:
        over, under = _quotient(pinhole, radial)
    distortion = (over[0], over[1], *tangential, over[2], *under)
    return replace(pinhole, model="FULL_OPENCV", distortion=distortion)


def fisheye_lens(pinhole: Lens, radial: Radial, tangential: Tangential) -> Lens:
    """The fisheye with this distortion, which is that of the angle from the axis: r = theta."""
    k1, k2, k3, k4 = radial
    if not any(tangential):
        return replace(pinhole, model="OPENCV_FISHEYE", distortion=radial)
    distortion = (k1, k2, *tangential, k3, k4, 0.0, 0.0)
    return replace(pinhole, model="THIN_PRISM_FISHEYE", distortion=distortion)


def _quotient(lens: Lens, radial: Radial) -> tuple[list[float], list[float]]:
    """Coefficients of r^2, r^4, r^6 over and under the line that come to the four terms."""
    radii = np.linspace(0.0, _reach(lens, radial), SAMPLES)
    best, error = np.zeros(6), math.inf
    # More terms under the line are not always better: their zeros can fall into the image.
    for terms in (1, 2, 3):
        found, moved = _fit(radii, _polynomial(radii, radial), terms)
        if moved < error:
            best, error = found, moved
    if not error * max(lens.fx, lens.fy) < FIT_ERROR:
        raise DataError(
            f"{lens.source}: its four radial terms k1 to k4 = {list(radial)} cannot be written as "
            "one of COLMAP's models.",
            "Estimate the cameras again without k4, or export undistorted images.",
        )
    return best[:3].tolist(), best[3:].tolist()


def _fit(
    radii: Float64[np.ndarray, " m"], wanted: Float64[np.ndarray, " m"], terms: int
) -> tuple[Float64[np.ndarray, " 6"], float]:
    """Fit a fraction with ``terms`` terms under the line, and the largest error of radii."""
    powers = radii[:, None] ** (2, 4, 6)
    # (1 + over) = wanted (1 + under) is linear in both; radii weigh by what they move.
    rows = np.concatenate([powers, -wanted[:, None] * powers[:, :terms]], axis=1) * radii[:, None]
    scale = np.abs(rows).max(axis=0)
    found, *_ = np.linalg.lstsq(rows / scale, (wanted - 1) * radii, rcond=None)
    found = np.concatenate([found / scale, np.zeros(3 - terms)])
    under = 1 + powers @ found[3:]
    if (under <= 0).any():
        return found, math.inf
    return found, float((np.abs((1 + powers @ found[:3]) / under - wanted) * radii).max())


def _reach(lens: Lens, radial: Radial) -> float:
    """Radius of the image's corners before distortion, at focal length 1."""
    corners = [(x, y) for x in (0, lens.width) for y in (0, lens.height)]
    needed = max(math.hypot((x - lens.cx) / lens.fx, (y - lens.cy) / lens.fy) for x, y in corners)
    radii = np.tan(np.linspace(0.0, math.radians(85), SAMPLES))
    bent = radii * _polynomial(radii, radial)
    # A lens that folds the image over before it gets there is refused later, in words.
    ends = np.flatnonzero((bent >= needed) | (np.diff(bent, append=math.inf) <= 0))
    return float(radii[ends[0] if len(ends) else -1])


def _polynomial(radii: Float64[np.ndarray, " m"], radial: Radial) -> Float64[np.ndarray, " m"]:
    """1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8."""
    values: Float64[np.ndarray, " m"] = 1 + radii[:, None] ** (2, 4, 6, 8) @ np.array(radial)
    return values
