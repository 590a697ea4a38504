"""Fixtures for tests of native operators."""

from collections.abc import Callable

import pytest


@pytest.fixture
def use_threads(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Sets the number of threads of the operators, whatever this machine has."""

    def use(threads: int) -> None:
        monkeypatch.setattr("gsfw.kernels.cpu.operators.num_threads", lambda: threads)

    return use
