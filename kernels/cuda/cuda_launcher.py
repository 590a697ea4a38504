"""CudaLauncher: runs kernels on a GPU, on the stream that torch is using there."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import NamedTuple

import torch

from gsfw.core.cores import cores
from gsfw.kernels.cuda.architecture import choose_target
from gsfw.kernels.cuda.cache import KernelCache, cache_folder
from gsfw.kernels.cuda.compiler import KernelCompiler
from gsfw.kernels.cuda.driver import Driver
from gsfw.kernels.cuda.errors import CudaError
from gsfw.kernels.cuda.launcher import Entry, Kernel, Launcher
from gsfw.kernels.cuda.nvrtc_library import find_nvrtc
from gsfw.kernels.cuda.torch_device import TorchDevice

MOST_BLOCKS = 2**31 - 1
"""Blocks that one launch may have."""


class _Loaded(NamedTuple):
    function: int
    job: type[ctypes.Structure]


class _Thread(threading.local):
    entered = False


class CudaLauncher(Launcher):
    """Launches on one device; threads may share it.

    Kernels stay loaded. Once a kernel has been launched, it may be captured in a CUDA graph.
    """

    def __init__(self, device: TorchDevice, driver: Driver, compiler: KernelCompiler) -> None:
        self.device = device
        self.driver = driver
        self.compiler = compiler
        self._loaded: dict[Kernel, _Loaded] = {}
        self._compiled: dict[Kernel, tuple[str, bytes]] = {}
        self._loading = threading.Lock()
        self._thread = _Thread()

    def reaches(self, device: torch.device) -> bool:
        """Only memory of its own GPU."""
        return device.type == "cuda" and device.index == self.device.index

    def captures(self) -> bool:
        """True while torch captures a CUDA graph on its current stream of the device."""
        return self.device.capturing()

    def prepare(self, kernels: Sequence[Entry]) -> None:
        """Compile in threads what is not loaded yet: NVRTC lets other threads run meanwhile."""
        missing = [entry for entry in kernels if entry[0] not in self._loaded]
        if len(missing) < 2 or self.device.capturing():
            return
        with ThreadPoolExecutor(min(len(missing), cores())) as threads:
            for entry, code in zip(
                missing, threads.map(self._try_to_compile, missing), strict=True
            ):
                if code is not None:
                    self._compiled[entry[0]] = code

    def _try_to_compile(self, entry: Entry) -> tuple[str, bytes] | None:
        try:
            return self.compiler.compile(*entry)
        except CudaError:  # The launch will meet it again, and say what it was for.
            return None

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        """Start a kernel on torch's current stream of the device; see ``Launcher.launch``.

        Raises:
            CudaError: it does not compile or load, or cannot be started.
            TypeError: the kernel has been launched with another class of jobs before.
        """
        if blocks == 0:
            return
        if blocks > MOST_BLOCKS:
            raise CudaError(
                f"{kernel.expression} would need {blocks} blocks of threads for what it is given; "
                f"CUDA starts {MOST_BLOCKS} at most.",
                "Render fewer splats, or a smaller image.",
            )
        try:
            if self.device.is_current():
                self._start(kernel, blocks, threads, job)
            else:
                with self.device.selected():
                    self._start(kernel, blocks, threads, job)
        except CudaError as error:
            raise CudaError(
                f"kernel {kernel.expression} on cuda:{self.device.index}: {error.message}",
                error.advice,
            ) from None

    def _start(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        """Start a kernel on the current device."""
        if not self._thread.entered:
            self.driver.enter(self.device.index)
            self._thread.entered = True
        loaded = self._loaded.get(kernel) or self._load(kernel, type(job))
        if type(job) is not loaded.job:
            raise TypeError(
                f"{kernel.expression} takes a {loaded.job.__name__}, found a {type(job).__name__}"
            )
        self.driver.launch(loaded.function, blocks, threads, self.device.stream(), job)

    def _load(self, kernel: Kernel, job: type[ctypes.Structure]) -> _Loaded:
        if self.device.capturing():
            raise CudaError(
                "it is used for the first time while a CUDA graph is being captured, when no "
                "kernel can be loaded.",
                "Run the step once before capturing it.",
            )
        with self._loading:
            if kernel not in self._loaded:  # Another thread may have been faster.
                compiled = self._compiled.pop(kernel, None)
                name, code = compiled or self.compiler.compile(kernel, job)
                self._loaded[kernel] = _Loaded(self.driver.load(code, name), job)
            return self._loaded[kernel]


def cuda_launcher(device: torch.device) -> CudaLauncher:
    """The launcher of a CUDA device, always the same one.

    Raises:
        CudaError: CUDA cannot be used on this machine; ``availability.unavailable`` says so first.
    """
    return _launcher(torch.cuda.current_device() if device.index is None else device.index)


@cache
def _launcher(index: int) -> CudaLauncher:
    device = TorchDevice(torch.device("cuda", index))
    nvrtc = find_nvrtc(torch.version.cuda)
    driver = Driver()
    driver.require(nvrtc.version)
    target = choose_target(device.architecture(), nvrtc.architectures)
    return CudaLauncher(device, driver, KernelCompiler(nvrtc, target, KernelCache(cache_folder())))
