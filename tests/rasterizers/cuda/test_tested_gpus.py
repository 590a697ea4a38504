"""GPUs that have passed the self-test: what is remembered, of which GPU, and what a fault means."""

import ctypes
from types import SimpleNamespace

import pytest
import torch

from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.launcher import Kernel, Launcher
from gsfw.rasterizers.cuda import config as config_module
from gsfw.rasterizers.cuda import tested_gpus
from gsfw.rasterizers.cuda.config import CudaConfig
from gsfw.rasterizers.cuda.self_test import SelfTest
from gsfw.rasterizers.cuda.tested_gpus import check_gpu, examine


class KnownDriver(Launcher):
    """Launches nothing."""

    def __init__(self, version: tuple[int, int]) -> None:
        self.driver = SimpleNamespace(version=version)

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        """No test asks for it."""
        raise NotImplementedError


class Machine:
    """Two GPUs of one kind, and the self-tests that were made there."""

    def __init__(self) -> None:
        self.fault = ""
        self.driver = (13, 0)
        self.made: list[str] = []

    def self_test(self, launcher: object, device: torch.device) -> SelfTest:
        """One that finds the fault of the moment."""
        self.made.append(str(device))
        return SelfTest(2.04, self.fault)

    def launcher(self, device: torch.device) -> Launcher:
        """One that knows its driver."""
        return KnownDriver(self.driver)


def properties_of(index: int) -> SimpleNamespace:
    return SimpleNamespace(name="NVIDIA H100", uuid=f"GPU-{index}")


def another_process() -> None:
    tested_gpus._check.cache_clear()
    tested_gpus._code.cache_clear()


@pytest.fixture
def machine(monkeypatch, tmp_path):
    machine = Machine()
    monkeypatch.setenv("GSFW_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(torch.cuda, "get_device_properties", properties_of)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda index: "NVIDIA H100")
    monkeypatch.setattr(torch.cuda, "current_device", lambda: 0)
    monkeypatch.setattr(tested_gpus, "cuda_launcher", machine.launcher)
    monkeypatch.setattr(tested_gpus, "self_test", machine.self_test)
    monkeypatch.setattr(config_module, "cuda_launcher", machine.launcher)
    monkeypatch.setattr(tested_gpus, "DRIVER_VERSION", tmp_path / "driver_version")
    another_process()
    yield machine
    another_process()


def test_a_gpu_is_tested_once_and_later_processes_know_it(machine, tmp_path):
    for _ in range(2):
        check_gpu(torch.device("cuda"))
        check_gpu(torch.device("cuda", 0))
        another_process()
    assert machine.made == ["cuda:0"]
    (record,) = (tmp_path / "cache" / "kernels").iterdir()
    assert record.read_text().startswith("NVIDIA H100 (cuda:0) passed in 2.0 s: ")


def test_each_of_several_gpus_is_tested(machine):
    check_gpu(torch.device("cuda", 0))
    check_gpu(torch.device("cuda", 1))
    assert machine.made == ["cuda:0", "cuda:1"]


def _new_driver(machine, monkeypatch, tmp_path):
    machine.driver = (13, 1)


def _new_kernel_module(machine, monkeypatch, tmp_path):
    (tmp_path / "driver_version").write_text("580.95.05\n")


def _new_torch(machine, monkeypatch, tmp_path):
    monkeypatch.setattr(torch, "__version__", "99.0")


def _new_card(machine, monkeypatch, tmp_path):
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda _: properties_of(7))


def _new_code(machine, monkeypatch, tmp_path):
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "blend.cu").write_text("// changed")
    monkeypatch.setattr(tested_gpus, "CODE", (*tested_gpus.CODE, tmp_path / "code"))


@pytest.mark.parametrize(
    "change", [_new_driver, _new_kernel_module, _new_torch, _new_card, _new_code]
)
def test_what_the_result_depends_on_asks_for_a_new_test(machine, monkeypatch, tmp_path, change):
    check_gpu(torch.device("cuda", 0))
    change(machine, monkeypatch, tmp_path)
    another_process()
    check_gpu(torch.device("cuda", 0))
    assert len(machine.made) == 2


def test_a_gpu_with_a_fault_is_refused_and_tested_again(machine):
    machine.fault = "a radix sort of 4097 keys of 32 bits has 3 of them in a wrong place"
    with pytest.raises(CudaError) as error:
        CudaConfig().build(torch.device("cuda", 1))
    assert str(error.value) == (
        "rasterizer cuda does not pass its self-test on NVIDIA H100 (cuda:1): a radix sort of "
        "4097 keys of 32 bits has 3 of them in a wrong place.\n"
        "Use rasterizer=gsplat if it is installed, or device=cpu; gsfw doctor repeats the test, "
        "and rasterizer.self_test=false renders without it."
    )
    machine.fault = ""
    CudaConfig().build(torch.device("cuda", 1))
    assert machine.made == ["cuda:1", "cuda:1"]


def test_the_test_can_be_left_out(machine):
    machine.fault = "it is wrong"
    CudaConfig(self_test=False).build(torch.device("cuda", 0))
    assert machine.made == []


def test_a_fault_found_later_is_remembered_against_an_earlier_pass(machine):
    check_gpu(torch.device("cuda", 0))
    machine.fault = "it is wrong"
    assert examine(0).fault
    another_process()
    with pytest.raises(CudaError):
        check_gpu(torch.device("cuda", 0))


def test_where_nothing_can_be_written_each_process_tests(machine, monkeypatch):
    monkeypatch.setenv("GSFW_CACHE_DIR", "/dev/null/gsfw")
    for _ in range(2):
        check_gpu(torch.device("cuda", 0))
        another_process()
    assert len(machine.made) == 2
