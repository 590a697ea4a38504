"""CUDA graphs and their memory; streams of packages that know the default stream alone."""

import gc
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

import pytest
import torch

from gsfw.core.loop.recording import CudaRecorder, on_default_stream

# Graphs and streams are stand-ins.
pytestmark = pytest.mark.unchecked


class Streams:
    """The streams of a GPU, and what waits for what."""

    def __init__(self, monkeypatch) -> None:
        self.order: list[str] = []
        self.default, self.own = Stream("default", self.order), Stream("own", self.order)
        self.current = self.own

        @contextmanager
        def within(stream):
            before, self.current = self.current, stream
            yield
            self.current = before

        monkeypatch.setattr(torch.cuda, "current_stream", lambda device: self.current)
        monkeypatch.setattr(torch.cuda, "default_stream", lambda device: self.default)
        monkeypatch.setattr(torch.cuda, "stream", within)


class Stream:
    def __init__(self, name: str, order: list[str]) -> None:
        self.name, self._order = name, order

    def wait_stream(self, other) -> None:
        self._order.append(f"{self.name} waits for {other.name}")


def test_work_on_the_default_stream_is_in_order_with_the_work_around_it(monkeypatch):
    streams = Streams(monkeypatch)
    with on_default_stream(torch.device("cuda", 0)):
        streams.order.append(f"work on {streams.current.name}")
    assert streams.current is streams.own
    assert streams.order == ["default waits for own", "work on default", "own waits for default"]


def test_later_work_waits_for_what_failed(monkeypatch):
    streams = Streams(monkeypatch)
    with pytest.raises(RuntimeError), on_default_stream(torch.device("cuda", 0)):
        raise RuntimeError("out of memory")
    assert streams.order[-1] == "own waits for default"


def test_the_cpu_has_no_streams():
    with on_default_stream(torch.device("cpu")):
        pass


class FakeGraph:
    """A CUDA graph of a driver that says what it is told to."""

    def __init__(self, driver: "Driver") -> None:
        self._driver = driver

    def capture_begin(self, pool: int, capture_error_mode: str) -> None:
        self._driver.told.append(f"begin in pool {pool}")

    def capture_end(self) -> None:
        self._driver.told.append("end")
        if self._driver.is_invalid:
            raise RuntimeError("operation failed due to a previous error during capture")

    def replay(self) -> None:
        if self._driver.replay_fault:
            raise RuntimeError(self._driver.replay_fault)


class Driver:
    """Stands in for the functions of torch that a recorder calls."""

    def __init__(self, monkeypatch) -> None:
        self.told: list[str] = []
        self.is_invalid, self.replay_fault = False, ""
        self.reserved = self.used = self.pools = 0
        for name, value in {
            "Stream": lambda device: SimpleNamespace(device_index=0),
            "graph_pool_handle": self._pool,
            "CUDAGraph": lambda: FakeGraph(self),
            "memory_reserved": lambda device: self.reserved,
            "memory_allocated": lambda device: self.used,
            "empty_cache": lambda: self.told.append("empty cache"),
        }.items():
            monkeypatch.setattr(torch.cuda, name, value)
        monkeypatch.setattr(torch, "zeros", lambda *size, device: None)
        names = ("_cuda_endAllocateToPool", "_cuda_releasePool")
        for name in names:
            told = partial(self._told_of_pool, name.removeprefix("_cuda_"))
            monkeypatch.setattr(torch._C, name, told, raising=False)

    def _pool(self) -> int:
        self.pools += 1
        return self.pools

    def _told_of_pool(self, name: str, index: int, pool: int) -> None:
        if name == "endAllocateToPool" and not self.is_invalid:
            raise RuntimeError("not currently recording to mempool_id")
        self.told.append(f"{name} {pool}")

    def takes(self, reserved: int, used: int = 0):
        """Work that takes so much memory."""

        def work() -> None:
            self.reserved += reserved
            self.used += used

        return work


def invalid(driver: Driver):
    def work() -> None:
        driver.is_invalid = True
        raise RuntimeError("operation not permitted when stream is capturing")

    return work


@pytest.fixture
def driver(monkeypatch) -> Driver:
    return Driver(monkeypatch)


@pytest.fixture
def recorder(driver) -> CudaRecorder:
    return CudaRecorder(torch.device("cuda", 0))


def test_a_capture_that_failed_is_ended_for_the_allocator_too(driver, recorder):
    recorder.record(driver.takes(10))
    driver.told.clear()
    with pytest.raises(RuntimeError, match="not permitted"):
        recorder.record(invalid(driver))
    assert driver.told == ["begin in pool 1", "end", "endAllocateToPool 1", "releasePool 1"]
    assert gc.isenabled()


def test_a_capture_that_is_interrupted_releases_its_pool_by_itself(driver, recorder):
    def interrupted() -> None:
        assert not gc.isenabled()
        raise KeyboardInterrupt

    recorder.record(driver.takes(10))
    driver.told.clear()
    with pytest.raises(KeyboardInterrupt):
        recorder.record(interrupted)
    assert driver.told == ["begin in pool 1", "end"]


def test_a_pool_that_was_outgrown_is_given_back(driver, recorder):
    driver.told.clear()
    for size in (100, 50, 40):
        recorder.record(driver.takes(size))
        recorder.release()
        assert driver.pools == 1
    recorder.record(driver.takes(20))
    recorder.release()
    assert (driver.pools, driver.told[-1]) == (2, "empty cache")
    recorder.record(driver.takes(130))
    assert driver.told[-2:] == ["begin in pool 2", "end"]
    recorder.release()
    assert driver.pools == 2
    recorder.release(at_once=True)
    assert driver.pools == 3


def test_memory_of_the_pool_without_its_tensors_is_idle(driver, recorder):
    first = recorder.record(driver.takes(100, used=30))
    second = recorder.record(driver.takes(0, used=10))
    assert recorder.idle_memory == 60
    del first
    assert recorder.idle_memory == 90
    del second
    recorder.release()
    assert recorder.idle_memory == 100
    recorder.release(at_once=True)
    assert recorder.idle_memory == 0


def test_a_replay_without_memory_says_so_as_torch_does(driver, recorder):
    recording = recorder.record(driver.takes(1))
    driver.replay_fault = "CUDA error: out of memory"
    with pytest.raises(torch.OutOfMemoryError):
        recording.replay()
    driver.replay_fault = "CUDA error: an illegal memory access was encountered"
    with pytest.raises(RuntimeError, match="illegal"):
        recording.replay()
