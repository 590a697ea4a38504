"""Emulated launcher: runs CUDA kernels on CPU tensors, one fiber per thread."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import re
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from support.native_programs import ROOT, compiler

from gsfw.kernels.cuda.launcher import Kernel, Launcher

HERE = Path(__file__).resolve().parent
SOURCES = ROOT / "kernels" / "cuda" / "sources"
SHARED = ROOT / "kernels" / "shared"

FLAGS = ("-std=c++20", "-O2", "-g1", "-fPIC", "-shared", "-pthread", "-DGSFW_FUNCTION=inline")
"""Of every compilation. Inlining is left to the compiler, which is faster to compile."""

NUMBERS = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-DGSFW_FUSES=1")
"""Arithmetic as a GPU has it: fused where the code says so, even if this machine must compute that
in software."""

SANITIZERS = {
    "": (),
    "address": ("-fsanitize=address", "-fno-omit-frame-pointer"),
    "undefined": ("-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all"),
}

MAX_THREADS = 1024

INSTANCE = """\
#include "device.h"
namespace {{
#include "{source}"
}}

using namespace gsfw::cuda;
{checks}
static void kernel(const void* job) {{ {expression}(*static_cast<const {job}*>(job)); }}

#ifndef __SANITIZE_ADDRESS__
static const void* shared_memory() {{
  static thread_local char anything;
  return &anything;
}}
#else
static const void* (*const shared_memory)() = nullptr;
#endif

extern "C" const unsigned launch_bound = {bound};

extern "C" int launch(const emulation::Launch* launch) {{
  return emulation::run(*launch, kernel, shared_memory);
}}
"""
"""The program of one instance.

Nothing in it is the linker's to choose among several files, since the address sanitizer leaves that
alone.
"""


def fused() -> tuple[str, ...]:
    """The flag for fused multiply-adds in hardware, where this processor has them behind one."""
    information = Path("/proc/cpuinfo")
    known = information.is_file() and " fma " in information.read_text(encoding="utf-8")
    return ("-mfma",) if known else ()


class EmulationError(RuntimeError):
    """A kernel does not compile, or its threads wait for each other forever."""


class Launch(ctypes.Structure):
    """``emulation::Launch`` of thread.h."""

    _fields_ = (
        ("blocks", ctypes.c_uint),
        ("threads", ctypes.c_uint),
        ("job", ctypes.c_void_p),
        ("seed", ctypes.c_uint64),
        ("system_threads", ctypes.c_int),
        ("message", ctypes.c_char_p),
        ("message_size", ctypes.c_uint64),
    )


class EmulatedLauncher(Launcher):
    """Runs kernels to their end before ``launch`` returns.

    Every block finds its shared memory full of NaN (bytes 0xff). Compiled kernels are kept in the
    system's folder for temporary files until something changes that they are made of.
    """

    def __init__(
        self,
        seed: int = 0,
        os_threads: int = 1,
        sanitize: str = "",
        folders: Sequence[Path] = (),
    ) -> None:
        """Compiles nothing yet; skips the test where there is no C++ compiler.

        Args:
            seed: 0 runs blocks and threads in order; any other, in a random order of its own.
            os_threads: how many blocks run at the same time.
            sanitize: "address" or "undefined", for programs that ``run_sanitized`` runs; "" for
                neither. With "address" shared memory is not poisoned.
            folders: where sources are looked for before kernels/cuda/sources.
        """
        if sanitize == "address" and os_threads != 1:
            raise ValueError("under the address sanitizer all blocks share one memory")
        self.seed = seed
        self.os_threads = os_threads
        self._compilation = Compilation(compiler(), sanitize, tuple(folders))
        self._programs: dict[tuple[Kernel, type[ctypes.Structure]], ctypes.CDLL] = {}

    def prepare(self, kernels: Iterable[tuple[Kernel, type[ctypes.Structure]]]) -> None:
        """Compile many kernels at once, each with the class of its job.

        Raises:
            EmulationError: one of them does not compile.
        """
        wanted = list(dict.fromkeys(kernels))
        self._compilation.runtime()
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            list(threads.map(lambda one: self._compilation.program(*one), wanted))

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        """Run ``blocks`` blocks of ``threads`` threads, and wait for them.

        Raises:
            EmulationError: the kernel does not compile, or it failed; says which threads wait
                where.
        """
        if blocks == 0:
            return
        if blocks < 0 or not 1 <= threads <= MAX_THREADS:
            raise ValueError(f"cannot run {blocks} blocks of {threads} threads")
        program = self._program(kernel, type(job))
        bound = ctypes.c_uint.in_dll(program, "launch_bound").value
        if threads > bound:
            raise EmulationError(
                f"{kernel.expression} of {kernel.source} has __launch_bounds__({bound}), "
                f"found blocks of {threads} threads"
            )
        message = ctypes.create_string_buffer(4096)
        request = Launch(
            blocks,
            threads,
            ctypes.addressof(job),
            self.seed,
            self.os_threads,
            ctypes.cast(message, ctypes.c_char_p),
            len(message),
        )
        if program.launch(ctypes.byref(request)) != 0:
            raise EmulationError(
                f"{kernel.expression} of {kernel.source}, {blocks} blocks of {threads} threads, "
                f"seed {self.seed}: {message.value.decode()}"
            )

    def _program(self, kernel: Kernel, job: type[ctypes.Structure]) -> ctypes.CDLL:
        key = (kernel, job)
        if key not in self._programs:
            self._programs[key] = ctypes.CDLL(str(self._compilation.program(*key)))
        return self._programs[key]


class Compilation:
    """Programs of kernels, compiled once per machine."""

    def __init__(self, command: str, sanitize: str, folders: tuple[Path, ...]) -> None:
        """See ``EmulatedLauncher``."""
        self.folders = (HERE, *folders, SOURCES, SHARED)
        self.command = [command, *FLAGS, *NUMBERS, *fused(), *SANITIZERS[sanitize]]

    def runtime(self) -> Path:
        """The library that runs fibers."""
        sources = [HERE / "runtime.cpp", HERE / "fiber.cpp"]
        headers = [HERE / "fiber.h", HERE / "thread.h"]
        key = _digest([*self._identity(), *(file.read_text() for file in [*sources, *headers])])
        return self._compile(f"runtime-{key}", [*map(str, sources)])

    def program(self, kernel: Kernel, job: type[ctypes.Structure]) -> Path:
        """The library of one instance of a kernel."""
        text = INSTANCE.format(
            source=kernel.source,
            expression=kernel.expression,
            job=job.__name__,
            checks="\n".join(_checks(job)),
            bound=self._launch_bound(kernel),
        )
        runtime = self.runtime()
        parts = [*self._identity(), text, str(runtime)]
        parts += self._included(text, {})
        return self._compile(
            f"kernel-{_digest(parts)}", ["-xc++", "-", "-xnone", str(runtime)], text
        )

    def _launch_bound(self, kernel: Kernel) -> str:
        """What the source promises: a constant, or an argument of the template."""
        name, _, arguments = kernel.expression.rstrip(">").partition("<")
        pattern = (
            r"(?:template <([^>]*)>\s+)?__global__ void "
            rf"__launch_bounds__\((\w+)[^)]*\)\s+{re.escape(name)}\("
        )
        found = re.search(pattern, self._find(kernel.source).read_text(encoding="utf-8"))
        if found is None:
            return str(MAX_THREADS)
        parameters = [
            parameter.split()[-1] for parameter in (found[1] or "").split(", ") if parameter
        ]
        given = dict(zip(parameters, arguments.split(", "), strict=False))
        return given.get(found[2], found[2])

    def _find(self, name: str) -> Path:
        for folder in self.folders:
            if (folder / name).is_file():
                return folder / name
        raise EmulationError(f"no {name} in any of {', '.join(map(str, self.folders))}")

    def _identity(self) -> list[str]:
        return [*self.command, _version(self.command[0])]

    def _included(self, text: str, seen: dict[str, str]) -> list[str]:
        for name in re.findall(r'^\s*#\s*include\s*"(.+?)"', text, re.MULTILINE):
            if name not in seen:
                seen[name] = self._find(name).read_text(encoding="utf-8")
                self._included(seen[name], seen)
        return list(seen.values())

    def _compile(self, name: str, arguments: list[str], text: str = "") -> Path:
        output = _cache() / f"{name}.so"
        if output.exists():
            return output
        # Other processes may compile the same, so that each writes a file of its own.
        handle, unfinished = tempfile.mkstemp(".so", f"{name}-", output.parent)
        os.close(handle)
        folders = [f"-I{folder}" for folder in self.folders]
        command = [*self.command, *folders, *arguments, "-o", unfinished]
        # What watches this process has no business in the compiler's.
        environment = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
        done = subprocess.run(
            command, input=text, capture_output=True, text=True, check=False, env=environment
        )
        if done.returncode != 0:
            os.unlink(unfinished)
            raise EmulationError(f"{text}\ndoes not compile:\n{done.stderr[-8000:]}")
        os.replace(unfinished, output)
        return output


def _digest(parts: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _cache() -> Path:
    owner = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"gsfw-emulation-{owner}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


@functools.cache
def _version(command: str) -> str:
    return subprocess.run([command, "--version"], capture_output=True, text=True, check=True).stdout


def _checks(job: type[ctypes.Structure]) -> Iterator[str]:
    """Assertions that C++ lays the structure out as ctypes does, field by field."""
    name = job.__name__
    yield f'static_assert(sizeof({name}) == {ctypes.sizeof(job)}, "size of {name}");'
    for field, offset in _offsets(job):
        yield f'static_assert(__builtin_offsetof({name}, {field}) == {offset}, "{name}.{field}");'


def _offsets(
    job: type[ctypes.Structure], path: str = "", start: int = 0
) -> Iterator[tuple[str, int]]:
    """Where every field lies, and every field of those that are structures."""
    for name, kind, *_ in job._fields_:
        offset = start + getattr(job, name).offset
        yield path + name, offset
        if issubclass(kind, ctypes.Structure):
            yield from _offsets(kind, f"{path}{name}.", offset)
