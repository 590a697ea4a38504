"""Fixtures for tests of native operators."""

from collections.abc import Callable

import pytest


@pytest.fixture
def use_threads(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Sets the number of threads of the operators, whatever this machine has."""

    def use(threads: int) -> None:
        for module in ("operators", "field", "stereo"):
            monkeypatch.setattr(f"gsfw.kernels.cpu.{module}.num_threads", lambda: threads)

    return use
