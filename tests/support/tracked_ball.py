"""The ball of ``checked_captures``, with the tracks that its points truly have."""

import struct
from pathlib import Path

import numpy as np

from support.checked_captures import BALL, Written, ball, write_ball

SLANT = 0.4
"""Cosine to the normal from which on a point of the ball is matched."""


def track_ball(folder: Path, points: int = 600, error: float = 0.0) -> Written:
    """A COLMAP capture of 48 images.

    Args:
        folder: where it goes.
        points: how many, all around the ball.
        error: what is told as the reprojection error of each, in pixels.
    """
    written = write_ball(folder, ball(count=48, points=points))
    centers = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in written.capture.poses])
    content = struct.pack("<Q", points)
    for number, point in enumerate(written.capture.points, 1):
        rays = centers - point
        cosines = rays @ point / BALL / np.linalg.norm(rays, axis=1)
        images = (np.flatnonzero(cosines > SLANT) + 1).tolist()
        content += struct.pack("<Q3d3BdQ", number, *point, 0, 0, 0, error, len(images))
        content += b"".join(struct.pack("<II", image, 0) for image in images)
    (folder / "sparse" / "0" / "points3D.bin").write_bytes(content)
    return written
