"""SamplingRates: how finely the training cameras sample each point of the scene."""

from __future__ import annotations

import torch

from gsfw.api import CameraModel

NEAREST = 0.2
"""Points at a smaller view depth, in scene units, are not sampled (the released code)."""
MARGIN = 0.15
"""A point this far outside an image, in parts of its sides, still counts (the released code)."""


class SamplingRates:
    """The maximal sampling rate of points over all training cameras."""

    def __init__(self, cameras):
        self.cameras = [camera.to(dtype=torch.float32) for camera in cameras]

    @torch.no_grad()
    def of(self, points):
        """Samples in a scene unit at each of the points [n, 3].

        A point that no camera samples has the lowest rate of the others.
        """
        best = points.new_zeros(len(points))
        for camera in self.cameras:
            best = torch.maximum(best, _rates(camera.to(points.device), points))
        seen = best > 0
        lowest = best[seen].min() if bool(seen.any()) else best.new_ones(())
        return torch.where(seen, best, lowest)


def _rates(camera, points):
    """Focal length over depth where the point is in the image; 0 elsewhere."""
    pose, matrix = camera.world_to_camera[0].detach(), camera.intrinsics[0]
    x, y, depth = (points @ pose[:3, :3].T + pose[:3, 3]).unbind(1)
    if camera.model is CameraModel.ORTHOGRAPHIC:
        return torch.full_like(depth, float(matrix[0, 0]))
    ahead = depth > NEAREST
    depth = depth.clamp_min(NEAREST)
    inside = ahead
    for offset, focal, center, size in (
        (x, matrix[0, 0], matrix[0, 2], camera.width),
        (y, matrix[1, 1], matrix[1, 2], camera.height),
    ):
        place = (focal * offset / depth + center) / size
        inside = inside & (place > -MARGIN) & (place < 1 + MARGIN)
    return torch.where(inside, torch.maximum(matrix[0, 0], matrix[1, 1]) / depth, 0.0)
