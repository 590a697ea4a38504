"""KernelCompiler: the code of a kernel, from the cache or from NVRTC."""

from __future__ import annotations

import ctypes
import logging
import time

from gsfw.core.progress import stage
from gsfw.kernels.cuda.architecture import Target
from gsfw.kernels.cuda.cache import KernelCache, cache_key
from gsfw.kernels.cuda.launcher import Kernel
from gsfw.kernels.cuda.nvrtc import OPTIONS, Nvrtc
from gsfw.kernels.cuda.program import NAMESPACE, program_text
from gsfw.kernels.cuda.source_files import headers, source_text

logger = logging.getLogger(__name__)


class KernelCompiler:
    """Compiles kernels for one target, each once per machine."""

    def __init__(self, nvrtc: Nvrtc, target: Target, cache: KernelCache) -> None:
        self.nvrtc = nvrtc
        self.target = target
        self.cache = cache
        self._announced = False

    def compile(self, kernel: Kernel, job: type[ctypes.Structure]) -> tuple[str, bytes]:
        """The kernel's name in its code, and the code.

        Raises:
            CudaError: it does not compile, for instance because ``job`` is not what it takes.
        """
        expression = f"{NAMESPACE}::{kernel.expression}"
        program = program_text(kernel.source, [job])
        files = {**headers(), kernel.source: source_text(kernel.source)}
        version = "{}.{}".format(*self.nvrtc.version)
        key = cache_key(
            [version, self.target.name, *OPTIONS, expression, program]
            + [text for file in sorted(files.items()) for text in file]
        )
        cached = self.cache.read(key)
        if cached is not None:
            logger.debug("%s for %s: from the cache", kernel.expression, self.target.name)
            return cached
        self._announce()
        began = time.perf_counter()
        with stage(f"compiling CUDA kernels for {self.target.name} (first use)"):
            compiled = self.nvrtc.compile(program, files, self.target, [expression])
        seconds = time.perf_counter() - began
        size = len(compiled.code)
        logger.debug(
            "%s for %s: %.2f s, %d bytes", kernel.expression, self.target.name, seconds, size
        )
        name = compiled.names[expression]
        self.cache.write(key, name, compiled.code)
        return name, compiled.code

    def _announce(self) -> None:
        if not self._announced:
            self._announced = True
            logger.info("compiling CUDA kernels for %s (first use)...", self.target.name)
