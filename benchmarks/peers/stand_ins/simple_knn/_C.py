"""The one function of simple-knn."""

from __future__ import annotations

import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

NEIGHBOURS = 3


def distCUDA2(points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Mean squared distance of each point to its three nearest neighbours."""
    values = points.numpy()
    distances, _ = cKDTree(values).query(values, k=NEIGHBOURS + 1)
    # The nearest one is the point itself.
    return torch.from_numpy((distances[:, 1:] ** 2).mean(1)).to(points.dtype)
