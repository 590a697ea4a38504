"""Dense start: surface points of any capture, from its training images (``init=dense``)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.maths.focus import object_place
from gsfw.core.operators import Operators
from gsfw.core.progress import stage, tracked
from gsfw.core.scene import Scene
from gsfw.core.stereo.surface import SurfacePoints, surface_points
from gsfw.core.stereo.views import StereoViews

MOST_VIEWS = 150
"""Cameras that are compared, evenly spaced among all, which bounds time and memory."""
MOST_PIXELS = 1_500_000
"""Pixels of all images together; sweeps take 1 to 2 seconds of a core for them."""
VIEW_PIXELS = 20_000
"""Most pixels of an image. Larger ones take longer than they gain: fox at 180x320 (300 steps, no
densification, points thinned evenly) comes to 24.85 dB with sweeps at 104x185, which take 1 s, and
to 25.34 with sweeps at 156x277, which take 4 s; at 359x640 to 24.76 dB, and to 24.52 with sweeps at
198x353, which take 9 s."""
PIXELS_PER_POINT = 2
"""Pixels of a training view for each point."""
LEAST_POINTS = 100
"""With fewer points other starts are better."""
LEAST_SHARE = 0.14
"""Least share of pixels that cameras confirm. At 5000 pixels an image fox, chair, plush and
garden_robot_mv have 0.76, 0.86, 0.60 and 0.39; with cameras turned by 2 degrees 0.16, 0.13, 0.16
and 0.13, by 5 degrees 0.08, 0.03, 0.07 and 0.09, and with shuffled ones 0.06, 0.05, 0.04 and
0.11."""
OBJECT_DEPTHS = (0.4, 2.4)
"""Nearest and farthest depth, in distances of the point that the cameras look at."""
EXTENT_DEPTHS = (0.2, 20.0)
"""The same in extents, for cameras that look at no common point."""
BACKGROUND_TOLERANCE = 0.015
"""Largest difference of a channel from the background's colour; JPEG changes it by less."""


@dataclass(frozen=True)
class Start:
    """The scene to start from, and notes for the user."""

    scene: Scene
    """The scene with the found points; unchanged if none were found."""
    notes: tuple[str, ...] = ()


def dense_count(view_pixels: int) -> int:
    """Points that a run on views of ``view_pixels`` can use; 0 pixels: no limit is known."""
    return max(view_pixels // PIXELS_PER_POINT, 1) if view_pixels > 0 else 0


def dense_downscale(full: DataManager) -> float:
    """Factor by which images are to be shrunk for stereo: a multiple of a quarter.

    Args:
        full: the capture at its full size: sizes of shrunk images are rounded, and factors that
            followed from them would differ between runs on one capture.
    """
    pixels = full.views(Split.TRAIN).pixels
    return max(1.0, round(4 * (pixels / VIEW_PIXELS) ** 0.5) / 4)


def dense_start(scene: Scene, found: SurfacePoints | str, most: int) -> Start:
    """The scene with points of the first time that most cameras show.

    Args:
        scene: the capture.
        found: its points, or why there are too few.
        most: largest number of points; 0: all.
    """
    return _started(scene, found, most) if not isinstance(found, str) else _as_it_was(scene, found)


def dense_surface(
    data: DataManager, background: Float[Tensor, " 3"] | None, operators: Operators
) -> SurfacePoints | str:
    """All points, or in a clause why there are too few.

    Args:
        data: the capture, at the size of ``dense_downscale``.
        background: colour of pixels that show no surface; ``None`` if that is not known.
        operators: do the work.
    """
    scene, views = data.scene, data.views(Split.TRAIN)
    chosen = chosen_views(views)
    if len(chosen) < 2:
        return f"{scene.name!r} has {len(chosen)} pinhole cameras at one time, not two"
    together = small_views(data, chosen, background)
    with stage("looking for surfaces in the images"):
        found = surface_points(together, scene.points, _bounds(scene), operators)
    if len(found) >= LEAST_POINTS and found.confirmed >= LEAST_SHARE:
        return found
    return (
        f"{len(chosen)} cameras agree on {found.confirmed:.0%} of their pixels (their poses are "
        "wrong, they stand in one place, or surfaces have no texture)"
    )


def _started(scene: Scene, found: SurfacePoints, most: int) -> Start:
    kept = found.thinned(most) if most else found
    changed = replace(
        scene, points=kept.points, point_colors=kept.colors.clamp(0.0, 1.0), point_times=None
    )
    share = "all " if len(kept) == len(found) else f"{len(kept):,} of "
    shown = f"{share}{len(found):,} surface points found in the images"
    return Start(changed, (f"Starting from {shown} (init=dense).",))


def _as_it_was(scene: Scene, cause: str) -> Start:
    """The fallback, in one sentence."""
    count = len(scene.points)
    instead = f"the {count:,} points of the data" if count else "random splats"
    return Start(scene, (f"init=dense: {cause}; starting from {instead}.",))


def chosen_views(views: Views) -> list[int]:
    """Pinhole views of the first time with the most of them; all of a static capture."""
    rows = _pinhole(views)
    if views.times is not None and rows:
        counts = Counter(views.times[row] for row in rows)
        time = min(counts, key=lambda each: (-counts[each], each))
        rows = [row for row in rows if views.times[row] == time]
    return _at_most(rows, MOST_VIEWS)


def views_of_places(views: Views) -> list[int]:
    """Pinhole views of all times: one of each pose, so that a fixed video camera has one."""
    first: dict[bytes, int] = {}
    for row in _pinhole(views):
        pose = views.cameras[row].world_to_camera.detach().float().numpy().tobytes()
        first.setdefault(pose, row)
    return _at_most(list(first.values()), MOST_VIEWS)


def _pinhole(views: Views) -> list[int]:
    return [i for i, camera in enumerate(views.cameras) if camera.model is CameraModel.PINHOLE]


def _at_most(rows: list[int], most: int) -> list[int]:
    """Some of the rows, evenly spaced."""
    return rows[:: max(1, -(-len(rows) // most))]


def _bounds(scene: Scene) -> tuple[float, float]:
    """Least and largest depth in scene units, from the cameras alone."""
    place = object_place(scene)
    unit = scene.extent if place is None else place[1]
    near, far = EXTENT_DEPTHS if place is None else OBJECT_DEPTHS
    return near * unit, far * unit


def small_views(
    data: DataManager, chosen: Sequence[int], background: Float[Tensor, " 3"] | None
) -> StereoViews:
    """Small images of training views, and their cameras.

    Args:
        data: the capture, at the size of ``dense_downscale``.
        chosen: pinhole views, at least one.
        background: colour of pixels that show no surface; ``None`` if that is not known.
    """
    views = data.views(Split.TRAIN)
    pixels, parts = min(VIEW_PIXELS, MOST_PIXELS // len(chosen)), []
    data.prefetch(Split.TRAIN, chosen)
    for view in tracked(chosen, "reading small images", len(chosen)):
        (batch,) = data.load(Split.TRAIN, (view,), torch.device("cpu"))
        parts.append(_image(batch, views.cameras[view], background).shrunk(pixels))
    return StereoViews(
        colors=tuple(part.colors[0] for part in parts),
        world_to_camera=torch.cat([part.world_to_camera for part in parts]),
        intrinsics=torch.cat([part.intrinsics for part in parts]),
        empty=tuple(part.empty[0] for part in parts),
        unknown=tuple(part.unknown[0] for part in parts),
    )


def _image(batch: Batch, camera: Cameras, background: Float[Tensor, " 3"] | None) -> StereoViews:
    """One image as stereo sees it."""
    image = batch.target(torch.ones(3) if background is None else background)[0]
    nothing = torch.zeros(image.shape[:2], dtype=torch.bool)
    empty = nothing if batch.coverage is None else batch.coverage[0, :, :, 0] < 0.5
    if background is not None:
        empty = empty | _is_background(image, background)
    return StereoViews(
        colors=(image,),
        world_to_camera=camera.world_to_camera.detach().double(),
        intrinsics=camera.intrinsics.detach().double(),
        empty=(empty,),
        unknown=(nothing if batch.valid is None else ~batch.valid[0, :, :, 0],),
    )


def _is_background(
    image: Float[Tensor, "h w 3"], background: Float[Tensor, " 3"]
) -> Bool[Tensor, "h w"]:
    return ((image - background).abs() < BACKGROUND_TOLERANCE).all(2)
