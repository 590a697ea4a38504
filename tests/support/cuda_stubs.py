"""What stands in for a GPU in tests of the host code: a driver, a compiler, torch's device."""

import ctypes
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from gsfw.kernels.cuda.architecture import Target
from gsfw.kernels.cuda.driver import Driver
from gsfw.kernels.cuda.nvrtc import OPTIONS, Compiled, Nvrtc
from gsfw.kernels.cuda.torch_device import TorchDevice
from support.native_programs import ROOT, compiler

SOURCE = ROOT / "tests" / "kernels" / "cuda" / "stub_driver.cpp"


class StubDriver:
    """The library of stub_driver.cpp, and what was called in it."""

    def __init__(self, folder: Path) -> None:
        self.path = str(folder / "libstub_driver.so")
        command = [compiler(), "-std=c++17", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror"]
        subprocess.run([*command, str(SOURCE), "-o", self.path], check=True)
        self._library = ctypes.CDLL(self.path)
        self._library.stub_calls.restype = ctypes.c_char_p
        self._library.stub_job.restype = ctypes.c_void_p

    def reset(self, version: int = 13000) -> None:
        self._library.stub_reset(version)

    def fail(self, function: str, status: int) -> None:
        self._library.stub_fail(function.encode(), status)

    def share(self, bytes_of_a_block: int) -> None:
        """Let every kernel have so much static shared memory."""
        self._library.stub_share(bytes_of_a_block)

    def expect_job(self, size: int) -> None:
        self._library.stub_expect_job(ctypes.c_size_t(size))

    def job(self, size: int) -> bytes:
        """What the kernel was launched with."""
        return ctypes.string_at(self._library.stub_job(), size)

    def calls(self) -> list[str]:
        return self._library.stub_calls().decode().splitlines()

    def driver(self) -> Driver:
        return Driver(self.path)


class FakeNvrtc(Nvrtc):
    """Compiles everything to a few bytes, and keeps what it was given."""

    def __init__(
        self, architectures: Sequence[int] = (75, 80, 90), version: tuple[int, int] = (13, 0)
    ) -> None:
        self.path = "fake"
        self.version = version
        self.architectures = list(architectures)
        self.compiled: list[tuple[str, str]] = []
        """Target and expression of each."""

    def compile(
        self,
        text: str,
        headers: Mapping[str, str],
        target: Target,
        expressions: Iterable[str],
        options: Sequence[str] = OPTIONS,
    ) -> Compiled:
        expressions = list(expressions)
        self.compiled += [(target.name, expression) for expression in expressions]
        code = b"\x7fELF machine code\0" if target.kind == "cubin" else b".visible .entry\0"
        return Compiled(code, {expression: "_Zkernel" for expression in expressions}, "")


class FakeDevice(TorchDevice):
    """A GPU whose stream, architecture and state tests choose."""

    def __init__(self, architecture: int = 90, stream: int = 77, index: int = 0) -> None:
        self.index = index
        self.streams = [stream]
        self.is_capturing = False
        self.current = True
        self.selections = 0
        self._architecture = architecture

    def is_current(self) -> bool:
        return self.current

    def selected(self) -> AbstractContextManager[object]:
        self.selections += 1
        return nullcontext()

    def stream(self) -> int:
        return self.streams[-1]

    def capturing(self) -> bool:
        return self.is_capturing

    def architecture(self) -> int:
        return self._architecture
