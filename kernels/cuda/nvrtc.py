"""NVRTC: NVIDIA's compiler as a library, called through ctypes.

Why not cuda-core: this is a hundred lines against functions whose binary interface is stable, adds
no dependency, needs no shim between versions of ``cuda.core``, and torch's own context and stream
are used either way.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gsfw.kernels.cuda.architecture import Target
from gsfw.kernels.cuda.errors import CudaError

OPTIONS = ("--std=c++17",)
"""Compiler options of every kernel. No fast mathematics: agreement with the CPU comes first."""


@dataclass(frozen=True)
class Compiled:
    """Result of a compilation."""

    code: bytes
    """A cubin, or PTX that ends with a zero byte."""
    names: Mapping[str, str]
    """The name in the code of each expression that was asked for."""
    log: str
    """Messages of the compiler; empty if there are none."""


class Nvrtc:
    """The compiler in one library file.

    Raises:
        CudaError: the library does not load.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = str(path)
        if sys.platform == "win32" and Path(path).is_absolute():
            os.add_dll_directory(str(Path(path).parent))  # It loads a library from beside it.
        try:
            self._library = ctypes.CDLL(self.path)
        except OSError as error:
            raise CudaError(f"NVRTC at {self.path} does not load: {error}") from None
        self._library.nvrtcGetErrorString.restype = ctypes.c_char_p
        self.version = self._find_version()
        """Major and minor version, that of the CUDA toolkit it is part of."""
        self._load_builtins()
        self.architectures = self._find_architectures()
        """Ten times each compute capability that it compiles for, ascending."""

    def compile(
        self,
        text: str,
        headers: Mapping[str, str],
        target: Target,
        expressions: Iterable[str],
        options: Sequence[str] = OPTIONS,
    ) -> Compiled:
        """Compile a program; other threads run meanwhile.

        Args:
            text: the program.
            headers: what it may include, by name.
            target: what to compile it to.
            expressions: the kernels wanted of it, such as "gsfw::cuda::blend<float, 3>".
            options: further options of the compiler.

        Raises:
            CudaError: it does not compile; the message carries the compiler's log.
        """
        expressions = list(expressions)
        program = ctypes.c_void_p()
        self._call(
            "nvrtcCreateProgram",
            ctypes.byref(program),
            text.encode(),
            b"program.cu",
            len(headers),
            _strings(headers.values()),
            _strings(headers),
        )
        try:
            for expression in expressions:
                self._call("nvrtcAddNameExpression", program, expression.encode())
            log = self._build(program, [f"--gpu-architecture={target.name}", *options])
            names = {expression: self._name(program, expression) for expression in expressions}
            what = "CUBIN" if target.kind == "cubin" else "PTX"
            return Compiled(self._bytes(program, what), names, log)
        finally:
            self._library.nvrtcDestroyProgram(ctypes.byref(program))

    def _build(self, program: ctypes.c_void_p, options: Sequence[str]) -> str:
        status = self._library.nvrtcCompileProgram(program, len(options), _strings(options))
        log = self._bytes(program, "ProgramLog").rstrip(b"\0").decode(errors="replace").strip()
        if status:
            raise CudaError(
                f"NVRTC {self.version[0]}.{self.version[1]} at {self.path} could not compile a "
                f"kernel with {' '.join(options)}: {self._error(status)}\n{log}",
                "This is a fault of gsfw or of its installation; please report it with this "
                "message. Until then, use rasterizer=cpu.",
            )
        return log

    def _bytes(self, program: ctypes.c_void_p, what: str) -> bytes:
        size = ctypes.c_size_t()
        self._call(f"nvrtcGet{what}Size", program, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self._call(f"nvrtcGet{what}", program, buffer)
        return buffer.raw

    def _name(self, program: ctypes.c_void_p, expression: str) -> str:
        name = ctypes.c_char_p()
        self._call("nvrtcGetLoweredName", program, expression.encode(), ctypes.byref(name))
        return (name.value or b"").decode()

    def _load_builtins(self) -> None:
        """Load the second library of the compiler, if it lies beside the first.

        It is opened by name when something is compiled, and the wheel of 13.0, which torch for
        CUDA 13.0 asks for, does not tell the system's loader to look there.
        """
        name = "libnvrtc-builtins.so.{}.{}".format(*self.version)
        beside = Path(self.path).with_name(name)
        if beside.is_absolute() and beside.is_file():
            with suppress(OSError):  # The compiler reports the consequences.
                ctypes.CDLL(str(beside))

    def _find_version(self) -> tuple[int, int]:
        major, minor = ctypes.c_int(), ctypes.c_int()
        self._call("nvrtcVersion", ctypes.byref(major), ctypes.byref(minor))
        return major.value, minor.value

    def _find_architectures(self) -> list[int]:
        count = ctypes.c_int()
        self._call("nvrtcGetNumSupportedArchs", ctypes.byref(count))
        found = (ctypes.c_int * count.value)()
        self._call("nvrtcGetSupportedArchs", found)
        return sorted(found)

    def _call(self, name: str, *arguments: object) -> None:
        function: Callable[..., int] = getattr(self._library, name)
        status = function(*arguments)
        if status:
            raise CudaError(f"{name} of NVRTC at {self.path} failed: {self._error(status)}")

    def _error(self, status: int) -> str:
        text: bytes = self._library.nvrtcGetErrorString(status)
        return text.decode()


def _strings(texts: Iterable[str]) -> ctypes.Array[ctypes.c_char_p]:
    encoded = [text.encode() for text in texts]
    return (ctypes.c_char_p * len(encoded))(*encoded)
