"""Surface points of a capture without points, from its training images (``init=stereo``)."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import interpolate

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.errors import ConfigError
from gsfw.core.maths.focus import object_place
from gsfw.core.maths.plane_sweep import confirmed_points, plane_sweep
from gsfw.core.progress import stage
from gsfw.core.scene import Scene

STEREO = "stereo"
"""Value of ``init`` for these points."""
LARGEST_SIDE = 200
"""Images are shrunk to this many pixels: nine of 200x150 take 40 s on one core, and four times the
pixels take four times as long."""
POINTS_PER_PIXEL = 4
"""Most points, in pixels of a training view at the size it is trained on."""
MOST_VIEWS = 48
"""Cameras that are compared, evenly spaced among all, which bounds the time to some minutes."""
LEAST_POINTS = 100
"""With fewer points random splats are the better start."""
OBJECT_DEPTHS = (0.4, 2.4)
"""Nearest and farthest depth, in distances of the point that the cameras look at."""
EXTENT_DEPTHS = (0.2, 20.0)
"""The same in extents, for cameras that look at no common point."""


def stereo_downscale(data: DataManager, downscale: float) -> float:
    """Factor by which images are to be shrunk for stereo: less than for training, if that is more.

    Args:
        data: the capture as it is trained on.
        downscale: the factor of its images.
    """
    first = data.views(Split.TRAIN).cameras[0]
    return max(1.0, downscale * min(1.0, max(first.width, first.height) / LARGEST_SIDE))


def with_stereo_points(
    data: DataManager, background: tuple[float, float, float], view_pixels: int
) -> Scene:
    """The scene with points of the first time that most cameras show.

    Args:
        data: the capture, at the size of ``stereo_downscale``.
        background: colour of what is empty, also behind images with alpha.
        view_pixels: pixels of a training view at the size it is trained on; 0 for no limit of
            points.

    Raises:
        ConfigError: the cameras do not show enough surface; names the remedy.
    """
    scene, views = data.scene, data.views(Split.TRAIN)
    chosen = chosen_views(views)
    if len(chosen) < 2 or any(views.cameras[i].model is not CameraModel.PINHOLE for i in chosen):
        raise ConfigError(
            f"init=stereo: {scene.name!r} has {len(chosen)} cameras at one time; expected at least "
            "two pinhole cameras that show the same instant.",
            "Use init=random, or a COLMAP model with points.",
        )
    with stage("looking for surfaces in the images"):
        behind = torch.tensor(background)
        images, cameras = _small_images(data, views, chosen, behind)
        found = plane_sweep(images, cameras, *_depths(scene), behind)
        points, colors = confirmed_points(images, cameras, found)
    if len(points) < LEAST_POINTS:
        raise ConfigError(
            f"init=stereo: {len(chosen)} cameras agree on {len(points)} points of {scene.name!r}; "
            f"expected at least {LEAST_POINTS}.",
            "Use init=random, or a smaller downscale.",
        )
    rows = _evenly(len(points), POINTS_PER_PIXEL * view_pixels or len(points))
    return replace(scene, points=points[rows], point_colors=colors[rows], point_times=None)


def _evenly(count: int, most: int) -> Int[Tensor, " r"]:
    """At most ``most`` of ``count`` rows, spread evenly."""
    return torch.arange(count) if count <= most else torch.arange(most) * count // most


def chosen_views(views: Views) -> list[int]:
    """Views of the first time with the most cameras; all of a static capture."""
    rows = list(range(len(views)))
    if views.times is not None:
        counts = Counter(views.times)
        time = min(counts, key=lambda each: (-counts[each], each))
        rows = [row for row in rows if views.times[row] == time]
    every = max(1, -(-len(rows) // MOST_VIEWS))
    return rows[::every]


def _depths(scene: Scene) -> tuple[float, float]:
    place = object_place(scene)
    unit = scene.extent if place is None else place[1]
    near, far = EXTENT_DEPTHS if place is None else OBJECT_DEPTHS
    return near * unit, far * unit


def _small_images(
    data: DataManager, views: Views, chosen: list[int], background: Float[Tensor, " 3"]
) -> tuple[Float[Tensor, "c h w 3"], Cameras]:
    """Images of the chosen views at one size, and their cameras."""
    first = views.cameras[chosen[0]]
    factor = min(1.0, LARGEST_SIDE / max(first.width, first.height))
    size = max(1, round(first.height * factor)), max(1, round(first.width * factor))
    images = []
    for view in chosen:
        (batch,) = data.load(Split.TRAIN, (view,), torch.device("cpu"))
        image = batch.target(background).permute(0, 3, 1, 2)
        images.append(interpolate(image, size, mode="area").permute(0, 2, 3, 1))
    cameras = [views.cameras[view].resized(size[1], size[0]) for view in chosen]
    together = Cameras(
        torch.cat([camera.world_to_camera for camera in cameras]),
        torch.cat([camera.intrinsics for camera in cameras]),
        size[1],
        size[0],
    )
    return torch.cat(images), together
