"""Tests of gsfw.kernels.cuda.driver, on a library that stands in for the real one."""

import ctypes
import os
import subprocess
import sys
import threading

import pytest

from gsfw.kernels.cuda import driver as driver_module
from gsfw.kernels.cuda.driver import Driver
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.jobs import Grid

CUBIN = b"\x7fELF machine code\0"


def test_code_is_loaded_and_started_with_a_copy_of_the_job(stub):
    driver = stub.driver()
    driver.enter(1)
    function = driver.load(CUBIN, "_Zkernel")
    stub.expect_job(ctypes.sizeof(Grid))
    driver.launch(function, 2**31 - 1, 256, 0x7FFF12345678, Grid(640, 480, 40, 30))
    assert stub.calls() == [
        "cuInit(0)",
        "cuDriverGetVersion()",
        "cuCtxGetCurrent()",
        "cuDeviceGet(1)",
        "cuDevicePrimaryCtxRetain(1)",
        "cuCtxSetCurrent(1)",
        "cuModuleLoadData(cubin)",
        "cuModuleGetFunction(_Zkernel)",
        "cuFuncGetAttribute(1)",
        f"cuLaunchKernel(2147483647 1 1 256 1 1 0 stream {0x7FFF12345678})",
    ]
    assert stub.job(ctypes.sizeof(Grid)) == bytes(Grid(640, 480, 40, 30))


def test_a_thread_that_has_a_context_keeps_it(stub):
    driver = stub.driver()
    driver.enter(1)
    driver.enter(0)
    assert stub.calls()[-2:] == ["cuCtxSetCurrent(1)", "cuCtxGetCurrent()"]


def test_a_new_thread_has_no_context_until_it_enters_one(stub):
    driver = stub.driver()
    driver.enter(0)
    function = driver.load(CUBIN, "_Zkernel")
    failures = []

    def work() -> None:
        try:
            driver.launch(function, 1, 32, 0, Grid())
        except CudaError as error:
            failures.append(error.message)
        driver.enter(0)
        driver.launch(function, 1, 32, 0, Grid())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert failures == ["starting 1 blocks of 32 threads failed: error 201, unknown (unknown)."]
    assert stub.calls()[-1] == "cuLaunchKernel(1 1 1 32 1 1 0 stream 0)"


def test_ptx_is_loaded_like_machine_code(stub):
    driver = stub.driver()
    driver.enter(0)
    assert driver.load(b".visible .entry _Zkernel()\0", "_Zkernel")
    assert "cuModuleLoadData(ptx)" in stub.calls()


def test_a_machine_without_a_driver_is_told_what_to_install():
    with pytest.raises(CudaError) as error:
        Driver("libno-such-driver.so.1")
    assert str(error.value) == (
        "there is no NVIDIA driver on this machine (libno-such-driver.so.1 does not load).\n"
        "Install one: https://www.nvidia.com/drivers; or use rasterizer=cpu."
    )


def test_a_driver_without_a_gpu_says_so(stub):
    stub.fail("cuInit", 100)
    with pytest.raises(CudaError) as error:
        stub.driver()
    assert str(error.value) == (
        "the NVIDIA driver finds no GPU.\n"
        "Is CUDA_VISIBLE_DEVICES set? Does nvidia-smi list one? Else use rasterizer=cpu."
    )


def test_a_driver_that_does_not_start_says_why(stub):
    stub.fail("cuInit", 999)
    with pytest.raises(CudaError) as error:
        stub.driver()
    assert str(error.value) == "starting the driver failed: error 999, unknown (unknown)."


def test_a_driver_older_than_the_compiler_is_refused_with_both_versions(stub):
    stub.reset(12040)
    driver = stub.driver()
    assert driver.version == (12, 4)
    driver.require((12, 8))  # Machine code needs the same major version only.
    with pytest.raises(CudaError) as error:
        driver.require((13, 0))
    assert str(error.value) == (
        "the NVIDIA driver is too old: it knows CUDA 12.4, and the kernels are compiled by NVRTC "
        "13.0, which needs a driver for CUDA 13.0 or newer.\n"
        "Update the driver, or install a torch built for CUDA 12: "
        "https://pytorch.org/get-started/locally"
    )


def test_a_newer_driver_runs_what_an_older_compiler_made(stub):
    stub.driver().require((12, 8))


def test_code_that_is_none_is_refused(stub):
    driver = stub.driver()
    driver.enter(0)
    with pytest.raises(CudaError) as error:
        driver.load(b"nonsense\0", "_Zkernel")
    assert str(error.value) == (
        "loading failed: error 200, CUDA_ERROR_INVALID_IMAGE (device kernel image is invalid)."
    )


def test_ptx_newer_than_the_driver_asks_for_a_newer_driver(stub):
    driver = stub.driver()
    driver.enter(0)
    stub.fail("cuModuleLoadData", 222)
    with pytest.raises(CudaError) as error:
        driver.load(b".visible .entry _Zkernel()\0", "_Zkernel")
    assert str(error.value) == (
        "the NVIDIA driver, which knows CUDA 13.0, cannot translate the PTX that is made for this "
        "GPU: the compiler is newer than the driver.\nUpdate the driver."
    )


def test_a_name_that_the_code_lacks_is_named(stub):
    driver = stub.driver()
    driver.enter(0)
    stub.fail("cuModuleGetFunction", 500)
    with pytest.raises(CudaError, match=r"^finding _Zkernel failed: error 500"):
        driver.load(CUBIN, "_Zkernel")


def test_a_failed_launch_says_that_the_cause_may_be_earlier(stub):
    driver = stub.driver()
    driver.enter(0)
    function = driver.load(CUBIN, "_Zkernel")
    stub.fail("cuLaunchKernel", 700)
    with pytest.raises(CudaError) as error:
        driver.launch(function, 3, 256, 0, Grid())
    assert str(error.value) == (
        "starting 3 blocks of 256 threads failed: error 700, CUDA_ERROR_ILLEGAL_ADDRESS "
        "(an illegal memory access was encountered).\n"
        "CUDA reports errors late: an earlier kernel may be the cause. "
        "Setting CUDA_LAUNCH_BLOCKING=1 shows which."
    )


def test_out_of_memory_in_the_driver_says_what_else_may_take_it(stub):
    driver = stub.driver()
    driver.enter(0)
    stub.fail("cuModuleLoadData", 2)
    with pytest.raises(CudaError) as error:
        driver.load(CUBIN, "_Zkernel")
    assert str(error.value) == (
        "loading failed: error 2, unknown (unknown).\n"
        "The driver keeps kernels outside of torch's memory: end other programs on the GPU "
        "(nvidia-smi lists them), or use less, for instance by downscale=2."
    )


@pytest.mark.parametrize(("shared", "is_large"), [(8191, False), (8192, True), (17312, True)])
def test_kernels_that_share_much_memory_ask_for_all_of_it(stub, shared, is_large):
    stub.share(shared)
    driver = stub.driver()
    driver.enter(0)
    assert driver.load(CUBIN, "_Zkernel")
    assert ("cuFuncSetAttribute(9 100)" in stub.calls()) is is_large


@pytest.mark.parametrize("refused", ["cuFuncGetAttribute", "cuFuncSetAttribute"])
def test_a_driver_may_refuse_to_share_more(stub, refused):
    stub.share(20000)
    stub.fail(refused, 801)
    driver = stub.driver()
    driver.enter(0)
    assert driver.load(CUBIN, "_Zkernel")


FORK = """
import os, sys
from gsfw.kernels.cuda.driver import Driver
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.jobs import Grid

driver = Driver(sys.argv[1])
driver.enter(0)
function = driver.load(b"\\x7fELF machine code\\0", "_Zkernel")
uses = {
    "start": lambda: Driver(sys.argv[1]),
    "enter": lambda: driver.enter(0),
    "load": lambda: driver.load(b"", "_Zkernel"),
    "launch": lambda: driver.launch(function, 1, 32, 0, Grid()),
}
child = os.fork()
if child == 0:
    for name, use in uses.items():
        try:
            use()
        except CudaError as error:
            print(name, "refused:", str(error).replace(chr(10), " "), flush=True)
    os._exit(0)
os.waitpid(child, 0)
driver.launch(function, 1, 32, 0, Grid())
print("the parent goes on")
"""
"""A process that uses the GPU, its fork that tries to, and the process after that."""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")
def test_a_fork_is_refused_with_one_sentence_and_its_parent_goes_on(stub):
    refused = (
        "refused: this process was forked from one that uses the GPU, and CUDA does not "
        'work in forked processes. Start processes by multiprocessing.get_context("spawn").'
    )
    *of_fork, of_parent = said_by(FORK, stub.path)
    assert of_fork == [f"{use} {refused}" for use in ("start", "enter", "load", "launch")]
    assert of_parent == "the parent goes on"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")
def test_a_fork_of_a_process_that_has_not_used_the_gpu_may_use_it(stub):
    program = """
import os, sys
from gsfw.kernels.cuda.driver import Driver
child = os.fork()
if child == 0:
    Driver(sys.argv[1]).enter(0)
    print("entered", flush=True)
    os._exit(0)
os.waitpid(child, 0)
"""
    assert said_by(program, stub.path) == ["entered"]
    without_a_driver = """
import sys
from gsfw.kernels.cuda.driver import Driver
from gsfw.kernels.cuda.errors import CudaError
try:
    Driver("libno-such-driver.so.1")
except CudaError:
    pass
"""
    assert said_by(without_a_driver + program, stub.path) == ["entered"]


def test_a_spawned_process_starts_a_driver_of_its_own(stub, tmp_path):
    program = tmp_path / "spawning.py"
    program.write_text("""
import multiprocessing, sys
from gsfw.kernels.cuda.driver import Driver

def work(library):
    Driver(library).enter(1)
    print("entered", flush=True)

if __name__ == "__main__":
    Driver(sys.argv[1]).enter(0)
    process = multiprocessing.get_context("spawn").Process(target=work, args=sys.argv[1:])
    process.start()
    process.join()
    print("exit code", process.exitcode)
""")
    done = subprocess.run(
        [sys.executable, str(program), stub.path], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == ["entered", "exit code 0"]


def test_a_fork_of_what_another_library_started_is_refused_too(stub, monkeypatch):
    monkeypatch.setattr(driver_module._Process, "is_fork", False)
    stub.fail("cuInit", 3)
    with pytest.raises(CudaError, match=r"^this process was forked from one that uses the GPU"):
        stub.driver()


def said_by(program: str, library: str) -> list[str]:
    """The lines that a Python program prints, given the path of a driver."""
    command = [sys.executable, "-c", program, library]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()
