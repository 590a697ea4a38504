"""Semi-global matching: depths of all pixels that agree with those of their neighbours.

Along straight paths the cost of a pixel at each plane gains the least cost of the previous pixel, a
small penalty for the next plane and a larger one for any other, which is smaller at edges of the
image (Hirschmueller 2008, "Stereo Processing by Semiglobal Matching and Mutual Information",
equations 11 to 14). Surfaces without texture so take the depths of their edges. Eight paths are
used, those of rows, columns and diagonals. This is the plain form;
``kernels/cpu/native/semi_global.h`` is the fast one.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

NEXT_PLANE = 6 / 128
"""Penalty of a step to the next plane; costs of a plane are in [0, 1]."""
OTHER_PLANE = 48 / 128
"""Penalty of any larger step where the image has no edge."""
EDGE_SHARPNESS = 16.0
"""The larger penalty is halved where greys differ by the inverse of this."""


def aggregate(costs: Float[Tensor, "p h w"], image: Float[Tensor, "h w"]) -> Float[Tensor, "p h w"]:
    """Mean over the eight paths of the costs along them.

    Args:
        costs: cost of each pixel at each plane, in [0, 1]; neighbouring planes in order.
        image: grey in [0, 1].
    """
    total = torch.zeros_like(costs)
    for aside in (-1, 0, 1):
        total += _from_above(costs, image, aside)
        total += _from_above(costs.flip(1), image.flip(0), aside).flip(1)
    costs, image = costs.transpose(1, 2), image.T
    total += _from_above(costs, image, 0).transpose(1, 2)
    total += _from_above(costs.flip(1), image.flip(0), 0).flip(1).transpose(1, 2)
    return total / 8.0


def best_plane(costs: Float[Tensor, "p h w"]) -> Float[Tensor, "h w"]:
    """Place of the least cost between planes: that of a parabola through three of them."""
    planes = len(costs)
    least = costs.argmin(0)
    middle = least.clamp(1, max(planes - 2, 1))
    before, here, after = (
        costs.gather(0, (middle + o).clamp(0, planes - 1)[None])[0] for o in (-1, 0, 1)
    )
    curvature = (before - 2.0 * here + after).clamp_min(1e-6)
    between = (0.5 * (before - after) / curvature).clamp(-0.5, 0.5)
    return torch.where(least == middle, middle + between, least)


def _from_above(
    costs: Float[Tensor, "p h w"], image: Float[Tensor, "h w"], aside: int
) -> Float[Tensor, "p h w"]:
    """Costs along the paths from the row above, ``aside`` columns to the right there."""
    previous = costs[:, 0]
    found = [previous]
    for row in range(1, costs.shape[1]):
        jumps = (image[row] - _moved(image[row - 1], aside)).abs()
        others = (OTHER_PLANE / (1.0 + EDGE_SHARPNESS * jumps)).clamp_min(NEXT_PLANE)
        before = _moved(previous, aside)
        least = before.amin(0)
        nearer = torch.cat([before[:1], before[:-1]])
        farther = torch.cat([before[1:], before[-1:]])
        stepped = torch.minimum(nearer, farther) + NEXT_PLANE
        reached = torch.minimum(torch.minimum(before, stepped), least + others)
        # Without the least cost the sums would grow along the path.
        previous = costs[:, row] + reached - least
        found.append(previous)
    return torch.stack(found, dim=1)


def _moved(row: Float[Tensor, "*p w"], aside: int) -> Float[Tensor, "*p w"]:
    """Values ``aside`` columns to the right; 0 from outside, where paths begin."""
    return pad(row, (1, 1))[..., 1 + aside : 1 + aside + row.shape[-1]]
