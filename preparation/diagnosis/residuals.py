"""Residuals: by how much points are seen off the places that they project to, and what is in it.

A rolling shutter exposes the rows of an image one after another, so that a camera that turns
meanwhile shears or stretches each image by its own motion. Bundle adjustment takes the part of
that which looks like another pose; what stays is a stretch along one axis and as much of a squeeze
across it, different in each image: residuals that grow linearly with the distance from the
middle, which noise does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from gsfw.preparation.mapping.observations import Observations

if TYPE_CHECKING:
    from pycolmap import Reconstruction

ENOUGH_POINTS = 30
"""An image that sees fewer says nothing of its stretch."""
ENOUGH_IMAGES = 3
"""Images of which a median means something."""
SUSPICIOUS_PIXELS = 0.3
"""At the edge of an image of 1024 pixels. Measured on synthetic captures (14 images, 400 points,
noise 0.5 and 1 pixel): 0.05 to 0.15 without motion, 0.35 to 0.41 where the camera turns by 0.05
degrees while rows are read, 1.3 by 0.2 degrees; 0.10 on 50 photos of a phone that stood still."""
SUSPICIOUS_NOISE = 0.35
"""Least effect that counts with any number of matches, in parts of ``Stretch.noise``:
errors that matches have in common stretch images by a part of the noise, at any size. Measured on
24 photos each of fox and plush at 200, 320 and 640 pixels: 0.14 to 0.21, with ratios up to 6.5. It
decides where the longer side is below 1200 times the noise, as 500 pixels at a noise of 0.42."""
SUSPICIOUS_RATIO = 5.0
"""``Stretch.ratio`` that is no chance, as noise alone makes about 1."""


@dataclass(frozen=True)
class Stretch:
    """Stretch of images, beyond the common one of their camera."""

    pixels: float
    """Median over images: the residual that it makes at the end of the longer side."""
    ratio: float
    """Median over images: its square over what noise alone would make; about 1 without it."""
    noise: float
    """Median over images: standard deviation of the residuals that are no stretch, in pixels along
    an axis."""
    longer_side: int
    """Pixels, of the largest camera."""

    @property
    def is_suspicious(self) -> bool:
        """True if a rolling shutter, or a camera that its model does not describe, is likely."""
        least = max(SUSPICIOUS_PIXELS * self.longer_side / 1024, SUSPICIOUS_NOISE * self.noise)
        return self.pixels > least and self.ratio > SUSPICIOUS_RATIO


def residuals_of(
    model: Reconstruction, seen: Observations
) -> tuple[Float64[np.ndarray, "o 2"], Float64[np.ndarray, "o 2"]]:
    """Places where points are seen, and those minus where they project to; in pixels."""
    places = np.zeros((len(seen.points), 2))
    projected = np.zeros_like(places)
    for number, rows in seen.by_image():
        image = model.image(number)
        pose = image.cam_from_world().matrix()
        local = seen.positions[seen.points[rows]] @ pose[:, :3].T + pose[:, 3]
        features = image.points2D
        found = [features[feature].xy for feature in seen.features[rows].tolist()]
        places[rows] = np.array(found).reshape(-1, 2)
        projected[rows] = model.camera(image.camera_id).img_from_cam(local, False)
    return places, places - projected


def errors_of(
    model: Reconstruction, seen: Observations, residuals: Float64[np.ndarray, "o 2"]
) -> dict[str, float]:
    """Mean reprojection error in pixels of each image that sees a point, by name."""
    sums = np.bincount(seen.images, np.linalg.norm(residuals, axis=1))
    counts = np.bincount(seen.images)
    return {
        model.image(int(seen.image_ids[place])).name: float(sums[place] / counts[place])
        for place in np.flatnonzero(counts)
    }


def stretch_of(
    model: Reconstruction,
    seen: Observations,
    places: Float64[np.ndarray, "o 2"],
    residuals: Float64[np.ndarray, "o 2"],
) -> Stretch:
    """Stretch of the images; NaN if too few see enough points."""
    fits: dict[int, list[tuple[np.ndarray, np.ndarray, float]]] = {}
    for number, rows in seen.by_image():
        if len(rows) >= ENOUGH_POINTS:
            camera = model.image(number).camera_id
            lens = model.camera(camera)
            middle = np.array([lens.width, lens.height]) / 2
            offsets = (places[rows] - middle) / (max(lens.width, lens.height) / 2)
            fits.setdefault(camera, []).append(_fit(offsets, residuals[rows]))
    side = max((max(c.width, c.height) for c in model.cameras.values()), default=0)
    pixels, ratios, noises = [], [], []
    for images in fits.values():
        # The common part of a camera's images is due to its lens, not to its motion.
        common = np.median([values for values, _, _ in images], axis=0)
        for values, inverse, noise in images:
            own = values - common
            pixels.append(np.linalg.norm(own))
            # Residuals that are exactly 0 would leave nothing to divide by.
            covariance = inverse * max(noise**2, 1e-12) + 1e-18 * np.eye(2)
            ratios.append(own @ np.linalg.solve(covariance, own) / len(own))
            noises.append(noise)
    if len(pixels) < ENOUGH_IMAGES:
        return Stretch(float("nan"), float("nan"), float("nan"), side)
    stretch, ratio, noise = (float(np.median(found)) for found in (pixels, ratios, noises))
    return Stretch(stretch, ratio, noise, side)


def _fit(
    offsets: Float64[np.ndarray, "f 2"], residuals: Float64[np.ndarray, "f 2"]
) -> tuple[Float64[np.ndarray, " 2"], Float64[np.ndarray, "2 2"], float]:
    """Least-squares stretch along the axes and along the diagonals, and its errors.

    Args:
        offsets: from the middle of the image, in halves of its longer side.
        residuals: pixels.

    Returns:
        The stretch in pixels, its covariance for noise of one pixel, and the standard deviation of
        the noise.
    """
    x, y = offsets.T
    basis = np.concatenate([np.stack([x, y], axis=1), np.stack([-y, x], axis=1)])
    wanted = np.concatenate([residuals[:, 0], residuals[:, 1]])
    inverse = np.linalg.pinv(basis.T @ basis)
    values = inverse @ (basis.T @ wanted)
    variance = ((wanted - basis @ values) ** 2).sum() / (len(wanted) - len(values))
    return values, inverse, float(np.sqrt(variance))
