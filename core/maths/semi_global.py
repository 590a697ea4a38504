"""Semi-global matching: depths of all pixels that agree with those of their neighbours.

Along straight paths the cost of a pixel at each plane gains the least cost of the previous pixel, a
small penalty for the next plane and a larger one for any other, which is smaller at edges of the
image (Hirschmueller 2008, "Stereo Processing by Semiglobal Matching and Mutual Information",
equations 11 to 14). Surfaces without texture so take the depths of their edges. Four paths are
used, those of rows and columns, instead of 8 or 16.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

NEXT_PLANE = 0.05
"""Penalty of a step to the next plane; costs of a plane are in [0, 1]."""
OTHER_PLANE = 0.4
"""Penalty of any larger step where the image has no edge."""
EDGE_SHARPNESS = 8.0
"""The larger penalty falls to 1/e of its excess where colours differ by the inverse of this."""


def aggregate(
    costs: Float[Tensor, "p h w"], image: Float[Tensor, "h w 3"]
) -> Float[Tensor, "p h w"]:
    """Mean over the four paths of the costs along them.

    Args:
        costs: cost of each pixel at each plane, in [0, 1]; neighbouring planes in order.
        image: colours in [0, 1].
    """
    total = _along_rows(costs, image)
    total += _along_rows(costs.flip(2), image.flip(1)).flip(2)
    costs, image = costs.transpose(1, 2), image.transpose(0, 1)
    total += _along_rows(costs, image).transpose(1, 2)
    total += _along_rows(costs.flip(2), image.flip(1)).flip(2).transpose(1, 2)
    return total / 4.0


def best_plane(costs: Float[Tensor, "p h w"]) -> Float[Tensor, "h w"]:
    """Place of the least cost between planes: that of a parabola through three of them."""
    planes = len(costs)
    middle = costs.argmin(0).clamp(1, planes - 2)
    before, least, after = (costs.gather(0, (middle + o)[None])[0] for o in (-1, 0, 1))
    curvature = (before - 2.0 * least + after).clamp_min(1e-6)
    return middle + (0.5 * (before - after) / curvature).clamp(-0.5, 0.5)


def _along_rows(
    costs: Float[Tensor, "p h w"], image: Float[Tensor, "h w 3"]
) -> Float[Tensor, "p h w"]:
    """Costs along the path from the left."""
    jumps = (image[:, 1:] - image[:, :-1]).abs().amax(2)
    others = NEXT_PLANE + (OTHER_PLANE - NEXT_PLANE) * (-EDGE_SHARPNESS * jumps).exp()
    previous = costs[:, :, 0]
    found = [previous]
    for column in range(1, costs.shape[2]):
        least = previous.amin(0)
        nearer = pad(previous[:-1], (0, 0, 1, 0), value=float("inf"))
        farther = pad(previous[1:], (0, 0, 0, 1), value=float("inf"))
        stepped = torch.minimum(nearer, farther) + NEXT_PLANE
        reached = torch.minimum(torch.minimum(previous, stepped), least + others[:, column - 1])
        # Without the least cost the sums would grow along the path.
        previous = costs[:, :, column] + reached - least
        found.append(previous)
    return torch.stack(found, dim=2)
