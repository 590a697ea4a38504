"""Visibility: which views see which points, by the tracks of a reconstruction or by projection.

Lin et al., VastGaussian (CVPR 2024), section 4.1, select cameras by what they see of a block and
not by where they stand. There it is the area of the block's box in the image; here it is the share
of the seen points, so that a block behind a wall counts for nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.progress import stage
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.frames import Frame

MOST_POINTS = 50_000
"""Points that are projected at most, evenly chosen: shares of them are exact to a fraction."""
TILES, POINTS = 24, 8
"""Rectangles along the longer side of an image, in each of which the nearest point hides others: as
many at most, and so few that about ``POINTS`` fall into each, or else a wall would have holes."""
BEHIND = 1.2
"""Factor of the depth of the nearest point of a rectangle from which on points are hidden: the
ground of a rectangle is not all at one depth."""
NEAR = 1e-6
"""Least depth of a point that is seen, in parts of the median depth."""


@dataclass(frozen=True)
class Visibility:
    """``o`` pairs of a view and a point that it sees."""

    names: tuple[str, ...]
    """Names of the views."""
    places: Float64[np.ndarray, "q 3"]
    """The points that were tried, in the world of the data."""
    views: Int64[np.ndarray, " o"]
    points: Int64[np.ndarray, " o"]
    """Rows of ``places``."""
    by_tracks: bool
    """True if the reconstruction says so; false if the points were projected."""

    def seen(self, chosen: Bool[np.ndarray, " q"]) -> Int64[np.ndarray, " v"]:
        """Number of the chosen points that each view sees."""
        return np.bincount(self.views[chosen[self.points]], minlength=len(self.names))

    def views_per_point(self) -> float:
        """Mean number of views that see a point, of those that any sees."""
        counts = np.bincount(self.points, minlength=len(self.places))
        return float(counts[counts > 0].mean()) if (counts > 0).any() else 0.0


def visibility(data: Capture) -> Visibility:
    """Find what each view of a capture sees.

    Args:
        data: with at least one point.

    Raises:
        DataError: the tracks of the reconstruction are damaged.
    """
    recording = data.recording
    frames = recording.frames
    names = tuple(frame.name for frame in frames)
    tracks = recording.read_sightings()
    if len(tracks.points):
        places = recording.points.numpy()
        return Visibility(names, places, tracks.frames, tracks.points, by_tracks=True)
    step = -(-len(recording.points) // MOST_POINTS)
    places = recording.points[::step].numpy()
    found: list[np.ndarray] = []
    with stage("finding what each view sees", len(frames)) as advance:
        for number, frame in enumerate(frames):
            found.append(_seen_by(frame, places))
            advance(number + 1)
    views = np.repeat(np.arange(len(frames)), [len(rows) for rows in found])
    return Visibility(names, places, views, np.concatenate(found), by_tracks=False)


def _seen_by(frame: Frame, places: Float64[np.ndarray, "q 3"]) -> Int64[np.ndarray, " s"]:
    """Rows of the points that fall into an image and are not behind others."""
    camera = frame.camera_at(1.0)
    across, depths = _projected(camera, places)
    size = np.array([camera.width, camera.height])
    inside = (depths > 0) & (across >= 0).all(axis=1) & (across < size).all(axis=1)
    rows = inside.nonzero()[0]
    if not len(rows):
        return rows
    rows = rows[depths[rows] > NEAR * np.median(depths[rows])]
    side = max(size) / np.clip(np.sqrt(len(rows) / POINTS), 1, TILES)
    columns = int(np.ceil(size[0] / side))
    tiles = (across[rows, 1] // side).astype(np.int64) * columns
    tiles += (across[rows, 0] // side).astype(np.int64)
    nearest = np.full(int(tiles.max(initial=0)) + 1, np.inf)
    np.minimum.at(nearest, tiles, depths[rows])
    return rows[depths[rows] <= BEHIND * nearest[tiles]]


def _projected(
    camera: Cameras, places: Float64[np.ndarray, "q 3"]
) -> tuple[Float64[np.ndarray, "q 2"], Float64[np.ndarray, " q"]]:
    """Pixels and depths of points; depths of a fisheye are distances."""
    pose, matrix = camera.world_to_camera[0].double().numpy(), camera.intrinsics[0].double().numpy()
    center = -pose[:3, :3].T @ pose[:3, 3]
    local = (places - center) @ pose[:3, :3].T
    depths = local[:, 2]
    focal, middle = matrix.diagonal()[:2], matrix[:2, 2]
    if camera.model is CameraModel.FISHEYE:
        radius = np.linalg.norm(local[:, :2], axis=1)
        angle = np.arctan2(radius, depths) / np.maximum(radius, 1e-300)
        return focal * local[:, :2] * angle[:, None] + middle, np.linalg.norm(local, axis=1)
    if camera.model is CameraModel.ORTHOGRAPHIC:
        return focal * local[:, :2] + middle, depths
    return focal * local[:, :2] / np.where(depths > 0, depths, 1.0)[:, None] + middle, depths


def camera_places(frames: Sequence[Frame]) -> Float64[np.ndarray, "v 3"]:
    """Positions of the cameras in the world of the data."""
    poses = torch.stack([frame.world_to_camera for frame in frames])
    return -(poses[:, :3, :3].transpose(1, 2) @ poses[:, :3, 3:])[:, :, 0].numpy()
