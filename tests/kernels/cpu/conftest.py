"""Fixtures for tests of native code: every instruction set, one thread and two."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets, native


@pytest.fixture(params=instruction_sets() or ["none"])
def instruction_set(request: pytest.FixtureRequest) -> Iterator[str]:
    """Each instruction set that this machine runs, in use during the test."""
    module: Any = native()
    if module is None:
        pytest.skip(NOT_BUILT)
    before = module.instruction_set()
    assert module.use_instruction_set(request.param)
    yield request.param
    module.use_instruction_set(before)


@pytest.fixture
def use_threads(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Sets the number of threads of the operators, whatever this machine has."""

    def use(threads: int) -> None:
        monkeypatch.setattr("gsfw.kernels.cpu.operators.num_threads", lambda: threads)

    return use
