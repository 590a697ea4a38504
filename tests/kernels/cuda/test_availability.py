"""Tests of gsfw.kernels.cuda.availability and nvrtc_library."""

import subprocess
import sys

import pytest
import torch
from support.cuda_stubs import FakeNvrtc

from gsfw.core.errors import UserError
from gsfw.kernels.cuda import driver, nvrtc_library
from gsfw.kernels.cuda.availability import cuda_system, unavailable
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.nvrtc_library import find_nvrtc


@pytest.fixture(autouse=True)
def _asked_again():
    unavailable.cache_clear()
    yield
    unavailable.cache_clear()


@pytest.fixture
def machine(stub, monkeypatch):
    """A machine where everything is there: one GPU of 9.0 and one of 6.1, CUDA 13.0."""
    monkeypatch.setattr(torch, "__version__", "2.13.0+cu130")
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    capabilities = {0: (9, 0), 1: (6, 1)}
    monkeypatch.setattr(torch.cuda, "get_device_capability", capabilities.__getitem__)
    monkeypatch.setattr(driver, "LIBRARY", stub.path)
    monkeypatch.setattr(nvrtc_library, "find_nvrtc", lambda cuda: FakeNvrtc())
    return capabilities


@pytest.mark.slow
def test_where_everything_is_there_it_is_available(machine):
    assert unavailable() == ""
    system = cuda_system()
    assert (system.targets, system.devices) == (("sm_90",), (0,))
    assert system.driver.version == system.nvrtc.version == (13, 0)


@pytest.mark.slow
def test_a_torch_without_cuda_is_named(machine, monkeypatch):
    monkeypatch.setattr(torch, "__version__", "2.13.0+cpu")
    monkeypatch.setattr(torch.version, "cuda", None)
    assert unavailable() == (
        "torch 2.13.0+cpu is a CPU build, without CUDA. "
        "Install a build of torch with CUDA: https://pytorch.org/get-started/locally."
    )


def test_a_torch_for_amd_is_named(machine, monkeypatch):
    monkeypatch.setattr(torch.version, "cuda", None)
    monkeypatch.setattr(torch.version, "hip", "6.4")
    assert unavailable().startswith("torch 2.13.0+cu130 is a ROCm build, without CUDA. ")


def test_a_missing_driver_comes_before_anything_else(machine, monkeypatch):
    monkeypatch.setattr(driver, "LIBRARY", "libno-driver.so.1")
    assert unavailable() == (
        "there is no NVIDIA driver on this machine (libno-driver.so.1 does not load). "
        "Install one: https://www.nvidia.com/drivers; or use rasterizer=cpu."
    )


def test_an_old_driver_is_named_with_versions(machine, stub):
    stub.reset(12080)
    assert unavailable().startswith(
        "the NVIDIA driver is too old: it knows CUDA 12.8, and the kernels are compiled by NVRTC "
        "13.0, which needs a driver for CUDA 13.0 or newer. Update the driver, or "
    )


def test_a_gpu_that_torch_cannot_use_is_referred_to_torch(machine, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert unavailable() == (
        "torch 2.13.0+cu130, built for CUDA 13.0, cannot use the GPU. "
        "python -c 'import torch; torch.zeros(1).cuda()' says why."
    )


def test_only_old_gpus_are_as_good_as_none(machine):
    machine[0] = (7, 0)
    assert unavailable().startswith("the GPU has compute capability 7.0; ")


def test_the_answer_is_found_once(machine, monkeypatch):
    assert unavailable() == ""
    monkeypatch.setattr(torch.version, "cuda", None)
    assert unavailable() == ""


@pytest.mark.parametrize(
    ("cuda", "missing", "built", "install"),
    [
        ("13.0", "13", "torch is built for CUDA 13.0", "nvidia-cuda-nvrtc==13.*"),
        ("12.8", "12", "torch is built for CUDA 12.8", "nvidia-cuda-nvrtc-cu12"),
        (None, "13 or 12", "torch is built without CUDA", "nvidia-cuda-nvrtc==13.*"),
    ],
)
def test_a_missing_compiler_says_what_to_install(monkeypatch, cuda, missing, built, install):
    monkeypatch.setattr(nvrtc_library, "_candidates", lambda major, folders: ["no-such.so"])
    with pytest.raises(CudaError) as error:
        find_nvrtc(cuda)
    assert str(error.value) == (
        f"NVRTC {missing}, the library that compiles CUDA kernels, was not found ({built}).\n"
        f'pip install "{install}"'
    )


def test_the_compiler_is_looked_for_where_pip_puts_it(tmp_path, monkeypatch):
    tried = []

    class Recorder(FakeNvrtc):
        def __init__(self, path: str) -> None:
            tried.append(path)
            raise CudaError("does not load")

    monkeypatch.setattr(nvrtc_library, "Nvrtc", Recorder)
    monkeypatch.setattr(sys, "prefix", "/conda")
    monkeypatch.setenv("CUDA_HOME", "/toolkit")
    monkeypatch.delenv("CUDA_PATH", raising=False)
    wheel = tmp_path / "nvidia" / "cuda_nvrtc" / "lib" / "libnvrtc.so.12"
    wheel.parent.mkdir(parents=True)
    wheel.touch()
    (wheel.parent / "libnvrtc.so.11.2").touch()
    with pytest.raises(CudaError, match=r"torch is built for CUDA 12.6\); does not load\.\n"):
        find_nvrtc("12.6", [str(tmp_path)])
    assert tried == [
        str(wheel),
        "/conda/lib/libnvrtc.so.12",
        "/toolkit/lib64/libnvrtc.so.12",
        "libnvrtc.so.12",
        "/usr/local/cuda/lib64/libnvrtc.so.12",
    ]


def test_errors_of_cuda_are_shown_without_a_traceback():
    assert issubclass(CudaError, UserError)


def test_asking_imports_no_torch_before_it_is_asked():
    code = "import sys, gsfw.kernels.cuda.availability; print('torch' in sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout == "False\n"
