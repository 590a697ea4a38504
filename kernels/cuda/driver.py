"""Driver: NVIDIA's driver library, called through ctypes.

Modules are loaded into the context that torch has made for a device (its primary context), with the
calls that CUDA has had since its first versions and that torch uses itself. A library that is
independent of contexts (``cuLibraryLoadData``) would gain nothing: a launcher serves one device.
"""

from __future__ import annotations

import ctypes
import os
import sys
from typing import NoReturn

from gsfw.kernels.cuda.errors import CudaError

LIBRARY = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
"""The file that the driver's installation puts where the system finds it."""

PTX_TOO_NEW = 222
"""CUDA_ERROR_UNSUPPORTED_PTX_VERSION: the compiler is newer than the driver."""

OUT_OF_MEMORY = 2
"""CUDA_ERROR_OUT_OF_MEMORY."""

NOT_INITIALIZED = 3
"""CUDA_ERROR_NOT_INITIALIZED: what ``cuInit`` says in the fork of a process that has called it."""

NO_DEVICE = 100
"""CUDA_ERROR_NO_DEVICE."""

SHARED_SIZE_BYTES = 1
"""CU_FUNC_ATTRIBUTE_SHARED_SIZE_BYTES: static shared memory of a block."""

SHARED_MEMORY_CARVEOUT = 9
"""CU_FUNC_ATTRIBUTE_PREFERRED_SHARED_MEMORY_CARVEOUT: shared memory in percent of the most."""

LARGE_SHARED_BYTES = 8 * 1024
"""Blocks that share at least this much get all memory that a multiprocessor can share.

Theirs is what bounds the number of resident blocks: 13 blocks of ``blend_backward``, as many as its
registers allow, need 225 of the 228 KB of an H100. Other kernels keep the L1 cache.
"""

LATE = (
    "CUDA reports errors late: an earlier kernel may be the cause. "
    "Setting CUDA_LAUNCH_BLOCKING=1 shows which."
)

MEMORY_ADVICE = (
    "The driver keeps kernels outside of torch's memory: end other programs on the GPU (nvidia-smi "
    "lists them), or use less, for instance by downscale=2."
)

_POINTER = ctypes.c_void_p


class _Process:
    """The use of the driver by this process, and by the one that it was forked from.

    A fork inherits the driver's memory but not its threads and contexts: every call fails or hangs.
    """

    started = False
    """True once a driver was started here, or in the process that this is a fork of."""
    is_fork = False
    """True in a fork of a process that had started a driver."""

    @classmethod
    def forked(cls) -> None:
        """Called in every child that is made by fork."""
        cls.is_fork = cls.started


if hasattr(os, "register_at_fork"):  # Not on Windows, where there is no fork.
    os.register_at_fork(after_in_child=_Process.forked)


def _refuse_forks() -> None:
    if _Process.is_fork:
        raise CudaError(
            "this process was forked from one that uses the GPU, and CUDA does not "
            "work in forked processes.",
            'Start processes by multiprocessing.get_context("spawn").',
        )


class Driver:
    """The driver in one library file.

    Raises:
        CudaError: there is no driver, or it finds no GPU; or this process is a fork of one that
            uses it.
    """

    def __init__(self, library: str | None = None) -> None:
        _refuse_forks()
        library = LIBRARY if library is None else library
        try:
            self._library = ctypes.CDLL(library)
        except OSError:
            raise CudaError(
                f"there is no NVIDIA driver on this machine ({library} does not load).",
                "Install one: https://www.nvidia.com/drivers; or use rasterizer=cpu.",
            ) from None
        # Without argtypes, whose conversions would take longer than all else of a launch.
        self._launch = self._library.cuLaunchKernel
        status = self._library.cuInit(0)
        if status == NOT_INITIALIZED:  # Somebody else, such as torch, had started it before.
            _Process.is_fork = True
            _refuse_forks()
        if status == NO_DEVICE:
            raise CudaError(
                "the NVIDIA driver finds no GPU.",
                "Is CUDA_VISIBLE_DEVICES set? Does nvidia-smi list one? Else use rasterizer=cpu.",
            )
        self._check(status, "starting the driver")
        _Process.started = True
        version = ctypes.c_int()
        self._check(self._library.cuDriverGetVersion(ctypes.byref(version)), "asking its version")
        self.version = (version.value // 1000, version.value % 1000 // 10)
        """Major and minor version of the newest CUDA that the driver knows."""

    def require(self, compiler: tuple[int, int]) -> None:
        """Check that the driver can run what a compiler of this version makes.

        Raises:
            CudaError: it is older by a major version.
        """
        if self.version[0] < compiler[0]:
            raise CudaError(
                f"the NVIDIA driver is too old: it knows CUDA {_dotted(self.version)}, and the "
                f"kernels are compiled by NVRTC {_dotted(compiler)}, which needs a driver for "
                f"CUDA {compiler[0]}.0 or newer.",
                f"Update the driver, or install a torch built for CUDA {self.version[0]}: "
                "https://pytorch.org/get-started/locally",
            )

    def enter(self, device: int) -> None:
        """Make torch's context of a device current in this thread, unless the thread has one.

        Threads that torch starts for the backward pass may not have touched their device yet.
        """
        _refuse_forks()
        context = _POINTER()
        what = f"entering the context of GPU {device}"
        self._check(self._library.cuCtxGetCurrent(ctypes.byref(context)), what)
        if context.value is None:
            ordinal = ctypes.c_int()
            self._check(self._library.cuDeviceGet(ctypes.byref(ordinal), device), what)
            retain = self._library.cuDevicePrimaryCtxRetain
            self._check(retain(ctypes.byref(context), ordinal), what)
            self._check(self._library.cuCtxSetCurrent(context), what)

    def load(self, code: bytes, name: str) -> int:
        """Load code into the current context, for as long as that lives; the kernel ``name``.

        Raises:
            CudaError: the code does not fit the device or the driver, or lacks the kernel; or this
                is a fork.
        """
        _refuse_forks()
        module, function = _POINTER(), _POINTER()
        status = self._library.cuModuleLoadData(ctypes.byref(module), code)
        if status == PTX_TOO_NEW:
            raise CudaError(
                f"the NVIDIA driver, which knows CUDA {_dotted(self.version)}, cannot translate "
                "the PTX that is made for this GPU: the compiler is newer than the driver.",
                "Update the driver.",
            )
        self._check(status, "loading")
        find = self._library.cuModuleGetFunction
        self._check(find(ctypes.byref(function), module, name.encode()), f"finding {name}")
        self._prefer_shared_memory(function)
        return function.value or 0

    def _prefer_shared_memory(self, function: ctypes.c_void_p) -> None:
        """Let many blocks be resident that share much memory; no more than a wish, and no failure.

        Left to itself the driver shares as much as one block needs, or a little more.
        """
        size = ctypes.c_int()
        status = self._library.cuFuncGetAttribute(ctypes.byref(size), SHARED_SIZE_BYTES, function)
        if status == 0 and size.value >= LARGE_SHARED_BYTES:
            self._library.cuFuncSetAttribute(function, SHARED_MEMORY_CARVEOUT, 100)

    def launch(
        self, function: int, blocks: int, threads: int, stream: int, job: ctypes.Structure
    ) -> None:
        """Start a kernel on a stream with one structure, which is copied before this returns.

        Raises:
            CudaError: it cannot be started, a kernel before it has failed, or this is a fork.
        """
        if _Process.is_fork:  # A call costs more than the question, and a step has many launches.
            _refuse_forks()
        jobs = ctypes.byref(_POINTER(ctypes.addressof(job)))
        handle, queue = _POINTER(function), _POINTER(stream)
        status = self._launch(handle, blocks, 1, 1, threads, 1, 1, 0, queue, jobs, None)
        if status:
            self._fail(status, f"starting {blocks} blocks of {threads} threads", LATE)

    def _check(self, status: int, what: str) -> None:
        if status:
            self._fail(status, what)

    def _fail(self, status: int, what: str, advice: str = "") -> NoReturn:
        texts = []
        for function in ("cuGetErrorName", "cuGetErrorString"):
            text = ctypes.c_char_p()
            getattr(self._library, function)(status, ctypes.byref(text))
            texts.append((text.value or b"unknown").decode())
        advice = MEMORY_ADVICE if status == OUT_OF_MEMORY else advice
        raise CudaError(f"{what} failed: error {status}, {texts[0]} ({texts[1]}).", advice)


def _dotted(version: tuple[int, int]) -> str:
    return f"{version[0]}.{version[1]}"
