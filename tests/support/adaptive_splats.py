"""Small adaptive spacetime models whose rows have different parameters of time."""

import torch

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.table import SplatTable
from gsfw.methods.spacetime.adaptive_model import AdaptiveSpacetimeGaussians
from support.moving_splats import spacetime


def adaptive(n: int = 12, **settings) -> tuple[AdaptiveSpacetimeGaussians, SplatTable]:
    """A model in float64 all of whose rows have everything, drawn at random; and its table."""
    model = spacetime(n=n, motion="adaptive", **settings)
    assert isinstance(model, AdaptiveSpacetimeGaussians)
    return model, SplatTable(model, Optimizer(model, Operators(), OptimizerSettings()))


def ragged(n: int = 12, **settings) -> tuple[AdaptiveSpacetimeGaussians, SplatTable]:
    """The same, of which rows have orders 0, 1, 2, 3, 0, ... and not all come and go, or turn."""
    model, table = adaptive(n, **settings)
    rows = torch.arange(n)
    table.resize("motion", rows % 4)
    for name, every in (("time_centers", 3), ("log_durations", 3), ("spins", 5)):
        table.resize(name, (rows % every != 0).long())
    return model, table
