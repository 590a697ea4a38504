"""The rasterizers, for statements that hold for any of them."""

import pytest
import torch

from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers import gsfw_rasterizers

SPECS = {spec.name: spec for spec in gsfw_rasterizers()}
"""Every backend of ours, by name."""


def built(name: str) -> Rasterizer:
    """The backend with its defaults; skips where it does not draw tensors on the CPU."""
    config = SPECS[name].load()()
    able = config.capabilities()
    if "cpu" not in able.devices:
        pytest.skip(able.unavailable or f"rasterizer {name!r} does not draw on the CPU")
    return config.build(torch.device("cpu"))


@pytest.fixture(params=list(SPECS))
def rasterizer(request: pytest.FixtureRequest) -> Rasterizer:
    """Each backend: what a test says of it, it says of any."""
    return built(request.param)


@pytest.fixture(params=[name for name in SPECS if name != "reference"])
def backend(request: pytest.FixtureRequest) -> Rasterizer:
    """Each backend that is measured against the reference."""
    return built(request.param)
