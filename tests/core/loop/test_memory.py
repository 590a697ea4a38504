"""Memory of a piece of work is what it takes beyond what is held before."""

import subprocess
import sys

import pytest
import torch

from gsfw.core.loop import memory
from gsfw.core.loop.memory import added_memory_mb

CPU = torch.device("cpu")


@pytest.fixture
def supported():
    if added_memory_mb(lambda: None, CPU) is None:
        pytest.skip("this system does not say how much memory a piece of work takes")


@pytest.mark.slow
def test_fifty_megabytes_are_seen_though_they_are_free_again_and_no_more_before(supported):
    before = torch.ones(10_000_000)
    found = added_memory_mb(lambda: torch.ones(12_500_000), CPU)
    assert 40.0 < found < 70.0
    assert before.sum() == 10_000_000


STARTER = """
import subprocess, sys
held = b"1" * 900_000_000
sys.exit(subprocess.run([sys.executable, "-c", sys.argv[1]]).returncode)
"""
MEASURED = """
import torch
from gsfw.core.loop.memory import added_memory_mb, peak_memory_mb

def many():
    return [torch.ones(250_000) for _ in range(50)]

print(peak_memory_mb(torch.device("cpu"))["rss"])
many()
print(*(added_memory_mb(many, torch.device("cpu")) for _ in range(2)))
"""


@pytest.fixture(scope="module")
def measured() -> list[float]:
    """Peak of a process that a larger one has started; memory that it uses once, and once more.

    It is a process of its own, as threads of other tests may free memory during a measurement.
    """
    command = [sys.executable, "-c", STARTER, MEASURED]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return list(map(float, done.stdout.split()))


@pytest.mark.slow
def test_memory_that_was_used_and_freed_before_counts_again(supported, measured):
    _, first, second = measured
    assert first > 40.0
    assert second > 40.0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems count in another way")
def test_the_peak_of_a_process_is_not_that_of_the_process_that_started_it(measured):
    assert 50 < measured[0] < 800


def test_work_that_takes_nothing_takes_nothing(supported):
    assert 0.0 <= added_memory_mb(lambda: None, CPU) < 5.0


@pytest.mark.parametrize("missing", ["CLEAR_REFS", "STATUS"])
def test_where_the_system_does_not_say_the_work_is_done_all_the_same(
    supported, monkeypatch, tmp_path, missing
):
    (tmp_path / "empty").touch()
    path = tmp_path / ("absent" if missing == "CLEAR_REFS" else "empty")
    monkeypatch.setattr(memory, missing, path)
    done = []
    assert added_memory_mb(lambda: done.append(1), CPU) is None
    assert done == [1]


def test_without_permission_it_is_not_known(monkeypatch, tmp_path):
    monkeypatch.setattr(memory, "CLEAR_REFS", tmp_path)  # A folder cannot be written to.
    assert added_memory_mb(lambda: None, CPU) is None


def test_of_other_devices_it_is_not_known():
    assert added_memory_mb(lambda: None, torch.device("mps")) is None


def test_on_a_gpu_it_is_what_torch_allocates_beyond_what_lay_there(monkeypatch):
    peak = [9e6]
    monkeypatch.setattr(torch.cuda, "reset_peak_memory_stats", lambda device: peak.clear())
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda device: 2e6)
    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda device: max(peak))
    assert added_memory_mb(lambda: peak.append(5e6), torch.device("cuda")) == 3.0
