"""Order: Gaussians along a balanced k-d tree, so that each node is a range of them."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor


def tree_order(means: Float[Tensor, "n 3"]) -> Int[Tensor, " n"]:
    """The rows in the order of the leaves of a balanced tree.

    Every block of 2^k rows from a multiple of 2^k on is a node; it is halved across its longest
    side (J. L. Bentley, Multidimensional Binary Search Trees, 1975). Only the last node of a level
    may be smaller than the others.
    """
    count = len(means)
    size = 1 << max(count - 1, 0).bit_length()
    order = np.concatenate([np.arange(count), np.full(size - count, count)])
    points = np.concatenate([means.double().numpy(), np.full((1, 3), np.inf)])
    while size > 1:
        blocks = order.reshape(-1, size)
        places = points[blocks]
        real = np.isfinite(places)
        sides = places.max(axis=1, where=real, initial=-np.inf)
        sides -= places.min(axis=1, where=real, initial=np.inf)
        axis = sides.argmax(axis=1)
        along = np.take_along_axis(places, axis[:, None, None], axis=2)[..., 0]
        # Padding is infinite, so that it stays behind all rows.
        halves = np.argpartition(along, size // 2 - 1, axis=1)
        order = np.take_along_axis(blocks, halves, axis=1)
        size //= 2
    return torch.from_numpy(order.reshape(-1)[:count].copy())
