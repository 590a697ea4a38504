"""The rasterizers, for statements that hold for any of them."""

import pytest
from support.backends import BACKENDS, NAMES

from gsfw.core.rasterizer import Rasterizer


@pytest.fixture(params=["reference", *NAMES])
def rasterizer(request: pytest.FixtureRequest) -> Rasterizer:
    """Each backend: what a test says of it, it says of any."""
    return BACKENDS[request.param]()


@pytest.fixture(params=NAMES)
def backend(request: pytest.FixtureRequest) -> Rasterizer:
    """Each backend that is measured against the reference."""
    return BACKENDS[request.param]()
