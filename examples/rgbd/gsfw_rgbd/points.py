"""Surface points of depth maps, to start from."""

from __future__ import annotations

import numpy as np
import torch
from PIL import Image

from gsfw.api import DataError


def surface_points(frames, count):
    """About ``count`` points of the frames' depth maps and their colours.

    Returns:
        Points [p, 3] in the world of the data, float64, and colours [p, 3] in [0, 1], float32.
    """
    share = -(-count // max(len(frames), 1))
    found = [_points_of(frame, share, number) for number, frame in enumerate(frames) if share]
    points = torch.cat([torch.zeros(0, 3, dtype=torch.float64), *(one for one, _ in found)])
    colors = torch.cat([torch.zeros(0, 3), *(one for _, one in found)])
    return points, colors


def _points_of(frame, count, seed):
    depth, lens = frame.maps["depth"].read()[..., 0], frame.lens
    try:
        with Image.open(frame.path) as image:
            pixels = np.asarray(image.convert("RGB"), np.float32) / 255
    except (OSError, SyntaxError) as error:  # Pillow raises both for files that are cut short.
        message = f"{frame.path} does not decode: {error}."
        raise DataError(message, "Copy the file again, or remove its line from rgb.txt.") from error
    rows, columns = np.nonzero(depth > 0)
    chosen = np.random.default_rng(seed).permutation(len(rows))[:count]
    rows, columns = rows[chosen], columns[chosen]
    # A depth map may be smaller than its image.
    x = (columns + 0.5) * lens.width / depth.shape[1]
    y = (rows + 0.5) * lens.height / depth.shape[0]
    z = depth[rows, columns].astype(np.float64)
    in_camera = np.stack([(x - lens.cx) / lens.fx * z, (y - lens.cy) / lens.fy * z, z], 1)
    pose = frame.world_to_camera
    world = (torch.from_numpy(in_camera) - pose[:3, 3]) @ pose[:3, :3]
    colors = pixels[y.astype(int), x.astype(int)]
    return world, torch.from_numpy(colors)
