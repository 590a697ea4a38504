"""The built-in scene at a small size, and the insides of its shapes."""

import torch

from gsfw.core.datamanager import DataRequest, Split
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.datamanagers.synthetic.shapes import Box, Cone, Cylinder, Sphere

CPU = torch.device("cpu")
HERE = DataRequest(None)

INSIDE = {
    Sphere: lambda p: p.norm(dim=0) - 1,
    Box: lambda p: p.abs().amax(dim=0) - 1,
    Cylinder: lambda p: torch.maximum(p[:2].norm(dim=0), p[2].abs()) - 1,
    Cone: lambda p: torch.maximum(p[:2].norm(dim=0) - (1 - p[2]) / 2, p[2].abs() - 1),
}
"""Functions that are negative inside each shape and 0 on its surface."""


def small(**changes):
    """Settings of the scene with six images of 32x24 pixels, but for the changes."""
    settings = {"views": 6, "eval_views": 2, "width": 32, "height": 24, "points": 200, "times": 3}
    return SyntheticConfig(**(settings | changes))


def images(data, split=Split.TRAIN):
    """All images of a split with their alpha. [views, h, w, 4]"""
    batches = data.load(split, range(len(data.views(split))), CPU)
    return torch.cat([torch.cat([batch.images, batch.alpha], dim=-1) for batch in batches])
