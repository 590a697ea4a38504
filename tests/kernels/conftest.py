"""Fixtures of the tests that all kernels pass."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import torch
from emulation.launcher import EmulatedLauncher

from gsfw.core.operators import Operators
from gsfw.kernels.cpu.native_module import instruction_sets, native
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.kernels.cuda.operators import CudaOperators

ON_CPU = [*instruction_sets(), "emulation"]
"""The instruction sets of this machine, and the emulation of CUDA."""
GPU = pytest.param(
    "gpu",
    marks=[
        pytest.mark.cuda,
        pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU on this machine"),
    ],
)


@contextmanager
def operators_of_kernels(name: str) -> Iterator[Operators]:
    """Operators over kernels by their name above."""
    if name in ("emulation", "gpu"):
        yield CudaOperators(EmulatedLauncher() if name == "emulation" else None)
        return
    before = native().instruction_set()
    assert native().use_instruction_set(name)
    yield CpuOperators()
    native().use_instruction_set(before)


@pytest.fixture(params=ON_CPU)
def operators(request: pytest.FixtureRequest) -> Iterator[Operators]:
    """Operators for tensors on the CPU."""
    with operators_of_kernels(request.param) as found:
        yield found


@pytest.fixture(scope="module", params=[*ON_CPU, GPU])
def kernels(request: pytest.FixtureRequest) -> str:
    """Name of the kernels."""
    return request.param


@pytest.fixture(scope="module")
def operators_there(kernels: str) -> Iterator[Operators]:
    """Operators for tensors in ``place``."""
    with operators_of_kernels(kernels) as found:
        yield found


@pytest.fixture(scope="module")
def place(kernels: str) -> torch.device:
    """The device that the kernels read."""
    return torch.device("cuda" if kernels == "gpu" else "cpu")


@pytest.fixture
def operators_of() -> Callable[[int], CudaOperators]:
    """Operators on the emulation, threads in the order of a seed; 0 is one after another."""
    return lambda seed: CudaOperators(EmulatedLauncher(seed))


@pytest.fixture
def use_threads(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Sets the number of threads of the operators, whatever this machine has."""

    def use(threads: int) -> None:
        for module in ("operators", "field", "stereo"):
            monkeypatch.setattr(f"gsfw.kernels.cpu.{module}.num_threads", lambda: threads)

    return use
