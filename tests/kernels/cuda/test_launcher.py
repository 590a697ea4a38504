"""Tests of gsfw.kernels.cuda.cuda_launcher and compiler, with stand-ins for what a GPU needs."""

import ctypes
import logging
import threading

import pytest
import torch
from support.cuda_stubs import FakeDevice, FakeNvrtc, StubDriver

from gsfw.kernels.cuda import compiler as compiler_module
from gsfw.kernels.cuda.architecture import choose_target
from gsfw.kernels.cuda.cache import KernelCache
from gsfw.kernels.cuda.compiler import KernelCompiler
from gsfw.kernels.cuda.cuda_launcher import CudaLauncher
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.jobs import BlendJob, Grid, TilesJob
from gsfw.kernels.cuda.launcher import Kernel, address
from gsfw.kernels.cuda.nvrtc import Nvrtc

BLEND = Kernel("blend.cu", "blend<float, 3, 128, false>")
TILES = Kernel("bin.cu", "find_tiles<uint16>")


def launcher_on(
    stub: StubDriver, nvrtc: Nvrtc, cache: KernelCache, device: FakeDevice | None = None
) -> CudaLauncher:
    device = device or FakeDevice()
    target = choose_target(device.architecture(), nvrtc.architectures)
    return CudaLauncher(device, stub.driver(), KernelCompiler(nvrtc, target, cache))


@pytest.fixture
def cache(tmp_path) -> KernelCache:
    return KernelCache(tmp_path)


@pytest.mark.slow
def test_the_first_launch_compiles_and_loads_and_the_next_only_launch(stub, cache):
    nvrtc = FakeNvrtc()
    launcher = launcher_on(stub, nvrtc, cache)
    stub.expect_job(ctypes.sizeof(BlendJob))
    job = BlendJob(grid=Grid(640, 480, 40, 30), channels=3, alpha_cap=0.25)
    launcher.launch(BLEND, 1200, 256, job)
    assert nvrtc.compiled == [("sm_90", "gsfw::cuda::blend<float, 3, 128, false>")]
    assert stub.calls()[2:] == [
        "cuCtxGetCurrent()",
        "cuDeviceGet(0)",
        "cuDevicePrimaryCtxRetain(0)",
        "cuCtxSetCurrent(0)",
        "cuModuleLoadData(cubin)",
        "cuModuleGetFunction(_Zkernel)",
        "cuFuncGetAttribute(1)",
        "cuLaunchKernel(1200 1 1 256 1 1 0 stream 77)",
    ]
    assert stub.job(ctypes.sizeof(BlendJob)) == bytes(job)
    before = len(stub.calls())
    launcher.launch(BLEND, 7, 256, job)
    assert stub.calls()[before:] == ["cuLaunchKernel(7 1 1 256 1 1 0 stream 77)"]
    assert len(nvrtc.compiled) == 1


def test_each_launch_asks_for_the_stream_of_the_moment(stub, cache):
    device = FakeDevice()
    launcher = launcher_on(stub, FakeNvrtc(), cache, device)
    launcher.launch(BLEND, 1, 256, BlendJob())
    device.streams.append(78)
    launcher.launch(BLEND, 1, 256, BlendJob())
    assert [call.split()[-1] for call in stub.calls() if "Launch" in call] == ["77)", "78)"]


def test_the_device_is_selected_only_where_another_one_is_current(stub, cache):
    device = FakeDevice()
    launcher = launcher_on(stub, FakeNvrtc(), cache, device)
    launcher.launch(BLEND, 1, 256, BlendJob())
    assert device.selections == 0
    device.current = False
    launcher.launch(BLEND, 1, 256, BlendJob())
    assert device.selections == 1


def test_nothing_is_started_for_no_blocks(stub, cache):
    nvrtc = FakeNvrtc()
    launcher_on(stub, nvrtc, cache).launch(BLEND, 0, 256, BlendJob())
    assert nvrtc.compiled == []
    assert stub.calls() == ["cuInit(0)", "cuDriverGetVersion()"]


def test_more_blocks_than_cuda_starts_are_refused(stub, cache):
    launcher = launcher_on(stub, FakeNvrtc(), cache)
    launcher.launch(BLEND, 2**31 - 1, 32, BlendJob())
    with pytest.raises(CudaError) as error:
        launcher.launch(BLEND, 2**31, 32, BlendJob())
    assert str(error.value) == (
        "blend<float, 3, 128, false> would need 2147483648 blocks of threads for what it is "
        "given; CUDA starts 2147483647 at most.\nRender fewer splats, or a smaller image."
    )


def test_another_process_finds_the_kernel_in_the_cache(stub, cache):
    launcher_on(stub, FakeNvrtc(), cache).launch(BLEND, 1, 256, BlendJob())
    nvrtc = FakeNvrtc()
    launcher_on(stub, nvrtc, cache).launch(BLEND, 1, 256, BlendJob())
    assert nvrtc.compiled == []


def test_what_changes_the_code_is_compiled_again(stub, cache, monkeypatch):
    def compilations(nvrtc: FakeNvrtc, architecture: int = 90) -> int:
        device = FakeDevice(architecture)
        launcher_on(stub, nvrtc, cache, device).launch(BLEND, 1, 256, BlendJob())
        return len(nvrtc.compiled)

    assert compilations(FakeNvrtc()) == 1
    assert compilations(FakeNvrtc(version=(13, 1))) == 1
    assert compilations(FakeNvrtc(), 80) == 1
    changed = {**compiler_module.headers(), "number.h": "// changed"}
    monkeypatch.setattr(compiler_module, "headers", lambda: changed)
    assert compilations(FakeNvrtc()) == 1
    monkeypatch.setattr(compiler_module, "source_text", lambda name: "// changed")
    assert compilations(FakeNvrtc()) == 1
    monkeypatch.setattr(compiler_module, "OPTIONS", ("--std=c++20",))
    assert compilations(FakeNvrtc()) == 1
    assert compilations(FakeNvrtc()) == 0


def test_a_gpu_newer_than_the_compiler_gets_ptx(stub, cache):
    nvrtc = FakeNvrtc([75, 80, 90])
    launcher = launcher_on(stub, nvrtc, cache, FakeDevice(120))
    launcher.launch(BLEND, 1, 256, BlendJob())
    assert nvrtc.compiled[0][0] == "compute_90"
    assert "cuModuleLoadData(ptx)" in stub.calls()


def test_people_are_told_once_that_kernels_are_being_compiled(stub, cache, caplog):
    launcher = launcher_on(stub, FakeNvrtc(), cache)
    with caplog.at_level(logging.INFO):
        launcher.launch(BLEND, 1, 256, BlendJob())
        launcher.launch(TILES, 1, 256, TilesJob())
    assert [record.getMessage() for record in caplog.records] == [
        "compiling CUDA kernels for sm_90 (first use)..."
    ]
    caplog.clear()
    with caplog.at_level(logging.DEBUG):
        launcher_on(stub, FakeNvrtc(), cache).launch(TILES, 1, 256, TilesJob())
    assert [record.getMessage() for record in caplog.records] == [
        "find_tiles<uint16> for sm_90: from the cache"
    ]


def test_a_kernel_takes_one_class_of_jobs(stub, cache):
    launcher = launcher_on(stub, FakeNvrtc(), cache)
    launcher.launch(BLEND, 1, 256, BlendJob())
    with pytest.raises(TypeError, match=r"^blend<float, 3, 128, false> takes a BlendJob, found a"):
        launcher.launch(BLEND, 1, 256, TilesJob())


def test_a_graph_captures_kernels_that_were_loaded_before(stub, cache):
    device = FakeDevice()
    launcher = launcher_on(stub, FakeNvrtc(), cache, device)
    launcher.launch(BLEND, 1, 256, BlendJob())
    device.is_capturing = True
    before = len(stub.calls())
    launcher.launch(BLEND, 1, 256, BlendJob())
    assert stub.calls()[before:] == ["cuLaunchKernel(1 1 1 256 1 1 0 stream 77)"]
    with pytest.raises(CudaError) as error:
        launcher.launch(TILES, 1, 256, TilesJob())
    assert str(error.value) == (
        "kernel find_tiles<uint16> on cuda:0: it is used for the first time while a CUDA graph is "
        "being captured, when no kernel can be loaded.\nRun the step once before capturing it."
    )


def test_threads_share_what_is_loaded_and_enter_the_device_themselves(stub, cache):
    nvrtc = FakeNvrtc()
    launcher = launcher_on(stub, nvrtc, cache, FakeDevice(index=2))
    errors = []

    def work() -> None:
        try:
            launcher.launch(BLEND, 1, 256, BlendJob())
            launcher.launch(BLEND, 1, 256, BlendJob())
        except CudaError as error:
            errors.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    assert len(nvrtc.compiled) == 1
    assert stub.calls().count("cuCtxSetCurrent(2)") == 4
    assert stub.calls().count("cuModuleLoadData(cubin)") == 1


def test_errors_name_the_kernel_and_the_device(stub, cache):
    launcher = launcher_on(stub, FakeNvrtc(), cache, FakeDevice(index=3))
    stub.fail("cuLaunchKernel", 700)
    with pytest.raises(CudaError) as error:
        launcher.launch(BLEND, 5, 256, BlendJob())
    assert str(error.value) == (
        "kernel blend<float, 3, 128, false> on cuda:3: starting 5 blocks of 256 threads failed: "
        "error 700, CUDA_ERROR_ILLEGAL_ADDRESS (an illegal memory access was encountered).\n"
        "CUDA reports errors late: an earlier kernel may be the cause. "
        "Setting CUDA_LAUNCH_BLOCKING=1 shows which."
    )


def test_a_job_that_differs_from_its_mirror_does_not_compile(stub, cache, nvrtc):
    class TilesJob(ctypes.Structure):
        """With two fields exchanged, which its size does not show."""

        _fields_ = (
            ("tiles", ctypes.c_void_p),
            ("count", ctypes.c_int64),
            ("counted", ctypes.c_void_p),
            ("unused", ctypes.c_int),
            ("num_tiles", ctypes.c_int),
            ("starts", ctypes.c_void_p),
        )

    launcher = launcher_on(stub, nvrtc, cache)
    with pytest.raises(CudaError) as error:
        launcher.launch(TILES, 1, 256, TilesJob())
    assert "the place of TilesJob.num_tiles differs from its mirror in Python" in str(error.value)
    assert "please report it with this message" in error.value.advice


def test_what_nvrtc_makes_is_what_the_driver_is_given(stub, cache, nvrtc):
    launcher = launcher_on(stub, nvrtc, cache)
    launcher.launch(TILES, 1, 256, TilesJob(count=10, num_tiles=4))
    assert "cuModuleLoadData(cubin)" in stub.calls()
    (name,) = [call for call in stub.calls() if call.startswith("cuModuleGetFunction")]
    assert "find_tiles" in name


def test_addresses_are_those_of_contiguous_tensors():
    tensor = torch.zeros(3, 4)
    assert address(tensor) == tensor.data_ptr()
    assert address(None) is None
    with pytest.raises(ValueError, match=r"^expected a contiguous tensor, found strides \(1, 4\)"):
        address(tensor.T)


def test_kernels_are_prepared_at_once_and_then_only_loaded(stub, cache):
    nvrtc = FakeNvrtc()
    launcher = launcher_on(stub, nvrtc, cache)
    launcher.prepare([(BLEND, BlendJob), (TILES, TilesJob)])
    assert len(nvrtc.compiled) == 2
    assert not any("Module" in call for call in stub.calls())
    launcher.launch(BLEND, 1, 256, BlendJob())
    launcher.launch(TILES, 1, 256, TilesJob())
    assert len(nvrtc.compiled) == 2
    launcher.prepare([(BLEND, BlendJob), (TILES, TilesJob)])
    assert len(nvrtc.compiled) == 2


def test_what_cannot_be_prepared_is_left_to_the_launch(stub, cache, nvrtc):
    launcher = launcher_on(stub, nvrtc, cache)
    nothing = Kernel("bin.cu", "no_such_kernel<float>")
    launcher.prepare([(nothing, TilesJob), (TILES, TilesJob)])
    launcher.launch(TILES, 1, 256, TilesJob())
    with pytest.raises(CudaError, match="no_such_kernel"):
        launcher.launch(nothing, 1, 256, TilesJob())


def test_only_memory_of_its_own_gpu_is_in_reach(stub, cache):
    launcher = launcher_on(stub, FakeNvrtc(), cache)
    index = launcher.device.index
    assert launcher.reaches(torch.device("cuda", index))
    assert not launcher.reaches(torch.device("cuda", index + 1))
    assert not launcher.reaches(torch.device("cpu"))
