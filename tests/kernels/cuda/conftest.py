"""Fixtures of the tests of the CUDA runtime."""

from collections.abc import Callable, Iterator

import pytest
from support.cuda_stubs import StubDriver

from gsfw.kernels.cuda.cache import KernelCache
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.nvrtc import Nvrtc
from gsfw.kernels.cuda.nvrtc_library import find_nvrtc
from gsfw.kernels.cuda.operators import CudaOperators


@pytest.fixture(scope="session")
def nvrtc() -> Nvrtc:
    """The compiler; skips where it is not installed."""
    try:
        return find_nvrtc(None)
    except CudaError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def _stub_driver(tmp_path_factory: pytest.TempPathFactory) -> StubDriver:
    return StubDriver(tmp_path_factory.mktemp("stub_driver"))


@pytest.fixture
def stub(_stub_driver: StubDriver) -> StubDriver:
    """A driver for CUDA 13.0 that nobody has called yet."""
    _stub_driver.reset()
    return _stub_driver


@pytest.fixture(autouse=True)
def _first_warning() -> Iterator[None]:
    """Each test is a process of its own as far as the cache's one warning goes."""
    KernelCache._warned = False
    yield
    KernelCache._warned = False


@pytest.fixture
def operators(operators_of: Callable[[int], CudaOperators]) -> CudaOperators:
    """Operators on the emulation."""
    return operators_of(0)
