"""C++ test programs, compiled at test time with the flags that the build has for kernels."""

import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NATIVE = ROOT / "kernels" / "cpu" / "native"

COMMON = ("-std=c++20", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-pthread")
"""Flags of every compilation, as CMakeLists.txt has them."""

CROSS_COMPILER, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
"""What builds and runs NEON elsewhere than on ARM (Debian: g++-aarch64-linux-gnu, qemu-user)."""


KERNELS = ("render", "step", "field", "stereo")
"""Parts of the engine that have kernels for every instruction set."""

DRIVERS = (
    *("bands", "blend_pass", "depth_fusion", "field", "instruction_sets", "pool"),
    *("project_pass", "render_pass", "sort", "step", "stereo"),
)
"""Sources of the rest."""


def compiler() -> str:
    """The machine's own; skips the test where there is none, or the system is not like Unix."""
    if sys.platform == "win32":
        pytest.skip("the test programs need mmap and fork")
    found = shutil.which(os.environ.get("CXX", "c++"))
    if found is None:
        pytest.skip("no C++ compiler on this machine")
    return found


def cross_compiler() -> str:
    """The one for ARM; skips the test unless its programs can be run as well."""
    for tool in (CROSS_COMPILER, EMULATOR):
        if shutil.which(tool) is None:
            pytest.skip(f"no {tool} on this machine")
    return CROSS_COMPILER


def linked_sets(machine: str) -> list[str]:
    """Instruction sets that every program for ``machine`` has, whether or not it can run them."""
    if machine in {"x86_64", "AMD64"}:
        return ["scalar", "avx2", "avx512"]
    return ["scalar", "neon"] if machine in {"aarch64", "arm64"} else ["scalar"]


MACHINE = platform.machine()


def flags_of(instruction_set: str) -> list[str]:
    """Definitions and flags with which ``instruction_set``'s kernels are compiled."""
    build = (NATIVE / "CMakeLists.txt").read_text(encoding="utf-8")
    found = re.search(rf"gsfw_kernels_for\({instruction_set}\b([^)]*)\)", build)
    assert found is not None, f"the build has no kernels for {instruction_set}"
    return [
        f"-DGSFW_ISA={instruction_set}",
        f"-DGSFW_SIMD_{instruction_set}",
        *found.group(1).split(),
    ]


def compile_source(
    command: str, source: Path, output: Path, flags: Sequence[str], objects: Sequence[Path] = ()
) -> Path:
    """Compile, and link unless ``-c`` is among ``flags``; fails the test with the messages.

    Args:
        command: the compiler.
        source: what it compiles.
        output: what it writes.
        flags: besides ``COMMON`` and the folders of headers.
        objects: what is linked besides.

    Returns:
        ``output``.
    """
    folders = [f"-I{NATIVE}", f"-I{ROOT / 'kernels' / 'shared'}"]
    files = ["-o", str(output), str(source), *map(str, objects)]
    arguments = [command, *COMMON, *folders, *flags, *files]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=300.0, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    return output


def compile_engine(
    command: str, sets: Sequence[str], flags: Sequence[str], folder: Path
) -> list[Path]:
    """Objects of the whole native engine but its bindings, written to ``folder``.

    What ``CMakeLists.txt`` forces to be inlined is left to the compiler, which is several times as
    fast to compile.

    Args:
        command: the compiler.
        sets: instruction sets of its machine, see ``linked_sets``.
        flags: besides those of each set.
        folder: where the objects go.
    """
    jobs = [(f"{name}_kernels", one) for one in sets for name in KERNELS]
    jobs += [("render_kernels_float64", "scalar"), ("field_kernels_float64", "scalar")]
    jobs += [(name, "") for name in DRIVERS]

    def build(job: tuple[str, str]) -> Path:
        name, instruction_set = job
        own = [*flags_of(instruction_set), "-DGSFW_FUNCTION=inline"] if instruction_set else []
        output = folder / f"{name}.{instruction_set}.o"
        return compile_source(command, NATIVE / f"{name}.cpp", output, [*own, *flags, "-c"])

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(build, jobs))


def run_program(command: Sequence[str], **environment: str) -> None:
    """Run a program; fails the test with what it says unless it exits with 0.

    Args:
        command: the program and its arguments.
        environment: variables besides those of the test.
    """
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
        env={**os.environ, **environment},
    )
    said = f"{done.stdout[-4000:]}{done.stderr[-8000:]}"
    assert done.returncode == 0, f"exit {done.returncode}\n{said}"
