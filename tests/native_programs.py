"""C++ test programs, compiled at test time with the flags that the build has for kernels."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NATIVE = ROOT / "kernels" / "cpu" / "native"

COMMON = ("-std=c++20", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-pthread")
"""Flags of every compilation; without the contraction the packs would differ from the numbers."""

CROSS_COMPILER, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
"""What builds and runs NEON elsewhere than on ARM (Debian: g++-aarch64-linux-gnu, qemu-user)."""


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
    command: str, source: Path, output: Path, flags: Sequence[str], timeout: float = 120.0
) -> Path:
    """Compile, and link unless ``-c`` is among ``flags``; fails the test with the messages.

    Args:
        command: the compiler.
        source: what it compiles.
        output: what it writes.
        flags: besides ``COMMON`` and the folders of headers.
        timeout: in seconds.
    """
    folders = [f"-I{NATIVE}", f"-I{ROOT / 'kernels' / 'shared'}"]
    arguments = [command, *COMMON, *folders, *flags, "-o", str(output), str(source)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=timeout, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    return output


def run_program(command: Sequence[str], timeout: float = 120.0, **environment: str) -> str:
    """What a program says on standard output; fails the test unless it exits with 0."""
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, (
        f"exit {done.returncode}\n{done.stdout[-4000:]}{done.stderr[-8000:]}"
    )
    return done.stdout
