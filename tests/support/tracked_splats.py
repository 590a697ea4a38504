"""Small models of tracked Gaussians, of random parameters."""

import torch

from gsfw.core.operators import Operators
from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig
from gsfw.methods.dynamic3d.model import TrackedGaussians
from support.moving_splats import moving_scene
from support.scenes import random_splats


def tracked(n: int = 20, degree: int = 1, **settings) -> TrackedGaussians:
    """A model in float64 before its first time."""
    config = TrackedGaussiansConfig(sh_degree=degree, **settings)
    initial = random_splats(n, degree=degree)
    generator = torch.Generator().manual_seed(0)
    model = config.build().build_model(moving_scene(), Operators(), generator, initial)
    assert isinstance(model, TrackedGaussians)
    return model.double()


@torch.no_grad()
def move_(model: TrackedGaussians, shift=(0.1, 0.0, 0.0), noise: float = 0.0, seed: int = 0):
    """Move every row, each a little differently with ``noise``, and turn it by as much."""
    generator = torch.Generator().manual_seed(seed)
    for column in (model.canonical.means, model.canonical.quats, model.canonical.sh_dc):
        values = column.values
        values += noise * torch.randn(values.shape, generator=generator, dtype=values.dtype)
    model.canonical.means.values += torch.tensor(shift, dtype=torch.float64)


def after(times: tuple[float, ...], noise: float = 0.05, **settings) -> TrackedGaussians:
    """A model that has moved at each of ``times``, of which it works on the last."""
    model = tracked(**settings)
    for index, time in enumerate(times):
        model.advance_(time)
        move_(model, noise=noise, seed=index)
    return model
