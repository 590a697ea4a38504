"""The second of several GPUs, by stand-ins: nothing is asked of torch's current device instead."""

from types import SimpleNamespace

import pytest
import torch
from support.cuda_stubs import FakeDevice, FakeNvrtc

from gsfw.kernels.cuda import cuda_launcher as launcher_module
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.torch_device import TorchDevice
from gsfw.rasterizers.cuda.stages import StageClock

SECOND = torch.device("cuda", 1)


class NoDriver(SimpleNamespace):
    """A driver that nothing is asked of but its version."""

    def require(self, compiler: tuple[int, int]) -> None:
        """It is new enough."""


@pytest.fixture
def two_gpus(monkeypatch):
    """Two GPUs of different generations; torch is using the first one."""
    architectures = {0: 90, 1: 80}
    monkeypatch.setattr(torch.cuda, "current_device", lambda: 0)
    monkeypatch.setattr(
        launcher_module,
        "TorchDevice",
        lambda device: FakeDevice(architectures[device.index], index=device.index),
    )
    monkeypatch.setattr(launcher_module, "find_nvrtc", lambda cuda: FakeNvrtc())
    monkeypatch.setattr(launcher_module, "Driver", NoDriver)
    launcher_module._launcher.cache_clear()
    yield
    launcher_module._launcher.cache_clear()


@pytest.mark.unchecked  # The driver is none.
def test_each_gpu_has_a_launcher_of_its_own_that_compiles_for_it(two_gpus):
    first, second = cuda_launcher(torch.device("cuda")), cuda_launcher(SECOND)
    assert first is cuda_launcher(torch.device("cuda", 0))
    assert second is cuda_launcher(SECOND)
    assert [one.device.index for one in (first, second)] == [0, 1]
    assert [one.compiler.target.name for one in (first, second)] == ["sm_90", "sm_80"]
    assert second.reaches(SECOND)
    assert not first.reaches(SECOND)


def test_stages_are_timed_on_the_stream_of_their_gpu(monkeypatch):
    recorded, waited = [], []

    class Event(SimpleNamespace):
        def record(self, stream: str) -> None:
            recorded.append(stream)

        def elapsed_time(self, end: object) -> float:
            return 1.5

    monkeypatch.setattr(torch.cuda, "Event", Event)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda device: f"stream of {device}")
    monkeypatch.setattr(torch.cuda, "synchronize", waited.append)
    clock = StageClock(True, SECOND)
    with clock.stage("blend"):
        pass
    assert clock.times() == {"blend": (1.5, 1.5)}
    assert recorded == ["stream of cuda:1"] * 2
    assert waited == [SECOND]


def test_a_capture_is_looked_for_on_the_gpu_of_the_launcher(monkeypatch):
    current = [0]

    class Selected:
        def __init__(self, index: int) -> None:
            self.index = index

        def __enter__(self) -> None:
            current.append(self.index)

        def __exit__(self, *error: object) -> None:
            current.pop()

    monkeypatch.setattr(torch.cuda, "init", lambda: None)
    monkeypatch.setattr(torch.cuda, "device", Selected)
    monkeypatch.setattr(torch.cuda, "current_device", lambda: current[-1])
    monkeypatch.setattr(torch._C, "_cuda_getDevice", lambda: current[-1], raising=False)
    monkeypatch.setattr(torch.cuda, "is_current_stream_capturing", lambda: current[-1] == 1)
    assert TorchDevice(SECOND).capturing()
    assert not TorchDevice(torch.device("cuda", 0)).capturing()
