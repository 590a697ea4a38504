"""The self-test of a GPU, on the emulation: it passes there, and finds planted faults."""

import ctypes
from collections.abc import Callable

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.native_programs import compiler

from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.launcher import Kernel, Launcher
from gsfw.rasterizers.cuda.self_test import SORT_SIZES, SelfTest, self_test

CPU = torch.device("cpu")

SIZES = tuple(size for size in SORT_SIZES if size < 10_000)
"""The emulation needs a minute for a million."""


class FaultyLauncher(Launcher):
    """Runs kernels on the emulation, but those whose launches a fault changes."""

    def __init__(self, fault: Callable[[Kernel, int, ctypes.Structure], bool]) -> None:
        """Plant a fault, which may change a job, and returns false if it is not to be run."""
        self._emulated = EmulatedLauncher()
        self._fault = fault

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        """As always, or not."""
        if self._fault(kernel, blocks, job):
            self._emulated.launch(kernel, blocks, threads, job)


def fault_of(fault: Callable[[Kernel, int, ctypes.Structure], bool]) -> str:
    compiler()
    return self_test(FaultyLauncher(fault), CPU, SIZES).fault


def test_the_emulation_passes_and_leaves_the_random_numbers_of_others_alone():
    compiler()
    before = torch.get_rng_state()
    with torch.no_grad():  # As in evaluation.
        found = self_test(EmulatedLauncher(seed=1), CPU, SIZES)
    assert found.fault == ""
    assert str(found) == (
        f"passed in {found.seconds:.1f} s: sorting, an image and its gradient are right"
    )
    assert torch.equal(torch.get_rng_state(), before)


def test_torchs_default_device_makes_no_difference():
    compiler()
    with torch.device("meta"):
        assert self_test(EmulatedLauncher(), CPU, SIZES).fault == ""


def test_a_sort_that_is_wrong_at_one_size_is_found():
    def lost(kernel: Kernel, blocks: int, job: ctypes.Structure) -> bool:
        """No sort of several blocks comes to its end."""
        if kernel.expression == "scatter<uint32>" and blocks > 1:
            ctypes.memset(job.sorted_keys, 0, 4 * job.count)
            ctypes.memset(job.sorted_payload, 0, 4 * job.count)
            return False
        return True

    found = fault_of(lost)
    assert found.startswith("a radix sort of 4097 keys of 32 bits has 409")
    assert found.endswith(" of them in a wrong place, the first one at 0")


def test_an_image_that_is_wrong_is_found_with_its_distance():
    def wider(kernel: Kernel, blocks: int, job: ctypes.Structure) -> bool:
        if kernel.expression.startswith("project<"):
            job.view.dilation += 0.05
        return True

    found = fault_of(wider)
    assert found.startswith("an image of 100x60 pixels differs from the reference's by 0.00")
    assert found.endswith(" in the mean, where 0.0001 are allowed")


def test_a_gradient_that_is_wrong_is_found_with_its_name():
    def narrower(kernel: Kernel, blocks: int, job: ctypes.Structure) -> bool:
        """The backward pass has other ellipses than the forward pass."""
        if kernel.expression.startswith("project_backward<"):
            job.forward.view.dilation = 0.0
        return True

    found = fault_of(narrower)
    assert found.startswith("the gradient by means differs from the reference's by ")
    assert found.endswith(" of its length, where 0.01 are allowed")


def raises(error: Exception) -> Callable[[Kernel, int, ctypes.Structure], bool]:
    def fault(kernel: Kernel, blocks: int, job: ctypes.Structure) -> bool:
        raise error

    return fault


def test_a_kernel_that_does_not_load_is_a_fault_with_its_message():
    assert fault_of(raises(CudaError("loading failed.", "Update the driver."))) == (
        "loading failed. Update the driver."
    )


def test_what_torch_says_of_a_broken_gpu_is_a_fault_in_one_line():
    error = RuntimeError("CUDA error: an illegal memory access was encountered\nFor debugging ...")
    assert fault_of(raises(error)) == (
        "it ended in RuntimeError: CUDA error: an illegal memory access was encountered"
    )


def test_full_memory_is_no_fault():
    with pytest.raises(torch.OutOfMemoryError):
        fault_of(raises(torch.OutOfMemoryError("CUDA out of memory.")))


def test_a_result_with_a_fault_reads_as_the_fault():
    assert str(SelfTest(1.0, "it is wrong")) == "it is wrong"
