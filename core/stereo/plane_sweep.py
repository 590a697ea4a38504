"""Plane sweep: depth of each pixel from images of neighbouring cameras.

For each depth of a set, neighbours are warped to the reference camera and compared in a window
(Collins 1996, "A Space-Sweep Approach to True Multi-Image Matching"). The cost of a pixel is the
mean of its two best neighbours, as others may not see the place (Kang et al. 2001). Semi-global
matching then chooses planes that neighbouring pixels agree on. This is the plain form;
``kernels/cpu/native/plane_sweep.h`` is the fast one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, pad

from gsfw.core.stereo.plans import SweepPlan
from gsfw.core.stereo.semi_global import aggregate, best_plane
from gsfw.core.stereo.views import StereoViews

REACH = 2
"""Half of the window, in pixels."""
LARGEST_DIFFERENCE = 0.25
"""Differences of grey above this count as this: what is hidden is no worse than wrong."""
DIFFERENCE_SHARE = 0.4
"""Part of the cost that is the difference of the pixel; the rest is 1 - correlation."""
LEAST_VARIANCE = 1e-4
"""Windows with less variance are taken to have this: noise correlates with nothing."""
AGREEING = 2
"""Neighbours that have to fit."""


@dataclass(frozen=True)
class DepthImage:
    """Depth of every pixel of one view."""

    depths: Float[Tensor, "h w"]
    """Along the axis of the camera, in scene units."""
    scores: Float[Tensor, "h w"]
    """Match with the neighbours, up to 1 (perfect)."""
    contrasts: Float[Tensor, "h w"]
    """Excess cost of the mean plane; near 0 where every plane fits."""


@dataclass(frozen=True)
class _Windows:
    """Means and variances of windows of one image."""

    image: Float[Tensor, "h w"]
    mean: Float[Tensor, "h w"]
    variance: Float[Tensor, "h w"]

    @staticmethod
    def of(image: Float[Tensor, "h w"]) -> _Windows:
        mean = _window_mean(image)
        return _Windows(image, mean, _window_mean(image * image) - mean * mean)

    def cost(self, other: _Windows) -> Float[Tensor, "h w"]:
        """The difference of the pixel, and 1 - correlation of its window; 0 to 1."""
        difference = (self.image - other.image).abs().clamp_max(LARGEST_DIFFERENCE)
        covariance = _window_mean(self.image * other.image) - self.mean * other.mean
        least = self.variance.clamp_min(LEAST_VARIANCE) * other.variance.clamp_min(LEAST_VARIANCE)
        correlation = (covariance / least.sqrt()).clamp(-1.0, 1.0)
        weighted = DIFFERENCE_SHARE * difference / LARGEST_DIFFERENCE
        return weighted + 0.5 * (1.0 - DIFFERENCE_SHARE) * (1.0 - correlation)


def sweep_views(views: StereoViews, plans: Sequence[SweepPlan]) -> list[DepthImage]:
    """Depths of the views of ``plans``, in their order."""
    return [_sweep(views, plan) for plan in plans]


def _sweep(views: StereoViews, plan: SweepPlan) -> DepthImage:
    inverse = torch.linspace(1.0 / plan.near, 1.0 / plan.far, plan.planes)
    costs = _costs(views, plan, 1.0 / inverse)
    smooth = aggregate(costs, views.grey[plan.view])
    chosen = best_plane(smooth)
    depths = 1.0 / torch.lerp(inverse[0], inverse[-1], chosen / (plan.planes - 1))
    scores = 1.0 - costs.gather(0, smooth.argmin(0)[None])[0]
    return DepthImage(depths, scores, smooth.mean(0) - smooth.amin(0))


def _costs(
    views: StereoViews, plan: SweepPlan, depths: Float[Tensor, " p"]
) -> Float[Tensor, "p h w"]:
    """Mean cost of the best neighbours at each depth; 1 for a neighbour that does not see it."""
    reference = _Windows.of(views.grey[plan.view])
    shape = views.size(plan.view)
    pixels = views.pixel_centers(plan.view)
    agreeing = min(AGREEING, len(plan.neighbors))
    found = []
    for depth in depths.tolist():
        places = views.unproject(plan.view, pixels, torch.full_like(pixels[:, 0], depth))
        costs = []
        for other in plan.neighbors:
            at, _, inside = views.project(other, places)
            warped = _interpolated(views.grey[other], at.float().view(*shape, 2))
            cost = reference.cost(_Windows.of(warped))
            costs.append(torch.where(inside.view(shape), cost, 1.0))
        found.append(torch.stack(costs).topk(agreeing, dim=0, largest=False).values.mean(0))
    return torch.stack(found)


def _interpolated(image: Float[Tensor, "_ _"], at: Float[Tensor, "h w 2"]) -> Float[Tensor, "h w"]:
    """Values between pixels; those at the edge go on beyond it."""
    size = torch.tensor([image.shape[1], image.shape[0]])
    grid = (at * (2.0 / size) - 1.0)[None]
    return grid_sample(image[None, None], grid, padding_mode="border", align_corners=False)[0, 0]


def _window_mean(values: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    padded = pad(values[None, None], (REACH,) * 4, mode="replicate")
    return avg_pool2d(padded, 2 * REACH + 1, stride=1)[0, 0]
