"""The limits of blending are measured where the native module can."""

from types import SimpleNamespace

import pytest
import torch

from gsfw.studies.bench import machine
from gsfw.studies.bench.machine import Limits, gpu, measure_limits


def test_the_limit_is_operations_over_throughput_and_one_exponential():
    limits = Limits(fma_gflops=258.0, exponential_gexp=19.1)
    assert limits.forward_ns == pytest.approx(17 / 129 + 1 / 19.1)
    assert limits.backward_ns == pytest.approx(36 / 129 + 1 / 19.1)


def test_the_best_of_several_attempts_counts(monkeypatch):
    fma, exponential = iter([90.0, 100.0, 95.0]), iter([8.0, 7.0, 6.0])
    module = SimpleNamespace(
        fma_gflops=lambda: next(fma), exponential_gexp=lambda: next(exponential)
    )
    monkeypatch.setattr(machine, "native", lambda: module)
    assert measure_limits() == Limits(100.0, 8.0)


@pytest.mark.parametrize("module", [None, SimpleNamespace(fma_gflops=lambda: 1.0)])
def test_without_the_functions_there_are_no_limits(monkeypatch, module):
    monkeypatch.setattr(machine, "native", lambda: module)
    assert measure_limits() is None


def test_the_cpu_is_no_gpu():
    assert gpu(torch.device("cpu")) is None
