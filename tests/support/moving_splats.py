"""Small spacetime models, of random parameters."""

from dataclasses import replace

import torch

from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.methods.spacetime.config import SpacetimeConfig
from gsfw.methods.spacetime.model import SpacetimeGaussians
from support.gaussians import toy_scene
from support.scenes import random_splats


def moving_scene(num_points: int = 30, **options) -> Scene:
    """A capture of 11 times."""
    return replace(toy_scene(num_points, time_range=(0.0, 1.0), num_times=11), **options)


def spacetime(
    n: int = 20, degree: int = 1, seed: int = 0, scene: Scene | None = None, **settings
) -> SpacetimeGaussians:
    """A model in float64 whose every parameter is drawn at random; the decoder's too."""
    config = SpacetimeConfig(sh_degree=degree, **settings)
    generator = torch.Generator().manual_seed(seed)
    initial = random_splats(n, degree=degree, seed=seed)
    model = config.build().build_model(scene or moving_scene(), Operators(), generator, initial)
    assert isinstance(model, SpacetimeGaussians)
    with torch.no_grad():
        for name in ("motion", "spins", "features", "feature_rates"):
            if name in model.columns():
                values = model.columns()[name].values
                values.copy_(0.3 * torch.randn(values.shape, generator=generator))
        durations = model.columns()["log_durations"].values
        durations.copy_((0.1 + 0.6 * torch.rand(n, generator=generator)).log())
        for parameter in () if model.decoder is None else model.decoder.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator))
    return model.double()


def at(time: float) -> torch.Tensor:
    return torch.tensor(time, dtype=torch.float64)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)
