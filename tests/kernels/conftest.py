"""Fixtures of the tests that all kernels pass."""

from collections.abc import Iterator

import pytest
from emulation.launcher import EmulatedLauncher

from gsfw.core.operators import Operators
from gsfw.kernels.cpu.native_module import instruction_sets, native
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.kernels.cuda.operators import CudaOperators


@pytest.fixture(params=[*instruction_sets(), "cuda"])
def operators(request: pytest.FixtureRequest) -> Iterator[Operators]:
    """Operators of the CPU with each instruction set of this machine, and of CUDA, emulated."""
    if request.param == "cuda":
        yield CudaOperators(EmulatedLauncher())
        return
    before = native().instruction_set()
    assert native().use_instruction_set(request.param)
    yield CpuOperators()
    native().use_instruction_set(before)
