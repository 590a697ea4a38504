"""Repetition: features that an image shows in several places, as those of tiles and windows.

Such a feature matches any of its like in another image, and matches of one wrong place agree with
each other, so that a wrong motion of the camera explains them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pycolmap import Camera, Database

ONCE = (
    "Show something that is there once in each image, such as a door, a sign, a corner or the "
    "ground: step back, or stick up posters."
)
"""Remedy for texture that repeats itself."""
ALIKE = 0.965
"""Cosine of two descriptors that are as like as matches: the median of fox's matches, and of those
of plush is 0.97."""
APART = 0.02
"""Distance of two features, in longer sides, from which on they show different places."""
IMAGES, FEATURES = 10, 500
"""Most images that are looked at, and features of each."""


def repeated_share(database: Database) -> float:
    """Part of the features of an image whose like is in it elsewhere; the median over images."""
    images = sorted(database.read_all_images(), key=lambda image: image.image_id)
    shares = [
        _share(database, image.image_id, database.read_camera(image.camera_id))
        for image in images[:: 1 + len(images) // IMAGES]
        if database.exists_descriptors(image.image_id)
    ]
    return float(np.median(shares)) if shares else 0.0


def _share(database: Database, number: int, camera: Camera) -> float:
    places = np.asarray(database.read_keypoints(number))[:, :2]
    if len(places) < 2:
        return 0.0
    vectors = np.asarray(database.read_descriptors(number).data, np.float32)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    chosen = slice(None, None, -(-len(places) // FEATURES))
    apart = np.linalg.norm(places[chosen, None] - places, axis=2)
    is_elsewhere = apart > APART * max(camera.width, camera.height)
    return float(((vectors[chosen] @ vectors.T > ALIKE) & is_elsewhere).any(1).mean())
