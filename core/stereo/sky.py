"""Directions in which the views of a capture see the sky: where they agree at infinite distance.

A camera's position does not change what it sees of the sky, so a direction has the same colour in
every view that no surface hides it from. Directions of near surfaces have different colours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.sky import Sky
from gsfw.core.stereo.views import StereoViews

PIXELS_APART = 6.0
"""Distance of neighbouring directions, in pixels of the views. Skies are smooth, and splats are
split where they are not."""
MOST_DIRECTIONS = 200_000
"""Directions of the whole sphere, at most: more for cameras with a narrow field of view."""
CHUNK = 20_000
"""Directions that are compared at a time, which bounds memory."""
TOLERANCE = 0.06
"""Largest difference of a channel from the median of all views that agrees with it."""
SAME_PLACE = 1e-3
"""Cameras nearer to each other than this, in radii of the sky, agree on near surfaces, too: they
count as one place, such as a fixed video camera, or the faces of a panorama."""
LEAST_PLACES = 2
"""Places of cameras that have to agree on a direction."""
AGREEING_SHARE = 0.5
"""Least share of the places that see a direction and agree; a surface hides it from the others."""
LEAST_POINTS = 20
"""With fewer directions there is no sky."""


def found_sky(views: StereoViews, sphere: Sky) -> Sky | str:
    """The sphere with points where views agree, or in a clause why it has none.

    Args:
        views: images of any times.
        sphere: the sky without points.
    """
    places = _places(views, SAME_PLACE * sphere.radius)
    if len(places) < LEAST_PLACES:
        return f"it takes pinhole cameras at {LEAST_PLACES} places, and there are {len(places)}"
    directions = even_directions(_number(views))
    parts = [_agreed(views, places, part) for part in directions.split(CHUNK)]
    kept, colors = (torch.cat(each) for each in zip(*parts, strict=True))
    if len(kept) < LEAST_POINTS:
        return f"cameras agree on {len(kept)} of {len(directions):,} directions"
    points = sphere.center.double() + sphere.radius * kept
    return replace(sphere, points=points.to(sphere.center), colors=colors)


def even_directions(count: int) -> Float64[Tensor, "count 3"]:
    """Unit vectors that are evenly spread over the sphere, along a spiral (Vogel 1979)."""
    number = torch.arange(count, dtype=torch.float64) + 0.5
    height = 1.0 - 2.0 * number / count
    angle = math.pi * (1.0 + math.sqrt(5.0)) * number
    across = (1.0 - height.square()).sqrt()
    return torch.stack([across * angle.cos(), across * angle.sin(), height], dim=1)


def _number(views: StereoViews) -> int:
    """Directions of the whole sphere, so that neighbours are ``PIXELS_APART`` in a usual view."""
    focal = float(views.intrinsics[:, 0, 0].median())
    return min(math.ceil(4.0 * math.pi * (focal / PIXELS_APART) ** 2), MOST_DIRECTIONS)


def _places(views: StereoViews, apart: float) -> list[list[int]]:
    """Views grouped by the places of their cameras, each within ``apart`` of the first there."""
    found: list[list[int]] = []
    for view, center in enumerate(views.centers):
        firsts = views.centers[[group[0] for group in found]]
        near = ((firsts - center).norm(dim=1) < apart).nonzero()[:, 0].tolist()
        if near:
            found[near[0]].append(view)
        else:
            found.append([view])
    return found


def _agreed(
    views: StereoViews, places: Sequence[Sequence[int]], directions: Float64[Tensor, "d 3"]
) -> tuple[Float64[Tensor, "s 3"], Float[Tensor, "s 3"]]:
    """The directions on which enough places agree, and their median colours."""
    colors = torch.stack([_seen_from(views, group, directions) for group in places])
    median = colors.nanmedian(dim=0).values
    seeing = (~colors[:, :, 0].isnan()).sum(dim=0)
    # Comparisons with NaN are false.
    agreeing = ((colors - median).abs().amax(dim=2) < TOLERANCE).sum(dim=0)
    kept = (agreeing >= LEAST_PLACES) & (agreeing >= AGREEING_SHARE * seeing)
    return directions[kept], median[kept]


def _seen_from(
    views: StereoViews, group: Sequence[int], directions: Float64[Tensor, "d 3"]
) -> Float[Tensor, "d 3"]:
    """Mean colours of directions in the views of one place; NaN where none has them."""
    total, count = torch.zeros(len(directions), 3), torch.zeros(len(directions), 1)
    for view in group:
        # A place at infinity: the position of the camera has no effect.
        pixels, _, seen = views.project(view, directions + views.centers[view])
        column, row = pixels[seen].long().T
        known = ~views.unknown[view][row, column]
        rows = seen.nonzero()[:, 0][known]
        total[rows] += views.colors[view][row[known], column[known]]
        count[rows] += 1.0
    return total / count  # 0 / 0 is NaN.
