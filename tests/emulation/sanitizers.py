"""Emulated kernels under the compiler's sanitizers, in a process of their own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.native_programs import ROOT, compiler


def run_sanitized(script: str, sanitize: str) -> subprocess.CompletedProcess[str]:
    """Run a Python program whose kernels a sanitizer watches; skips the test where there is none.

    The program makes its launcher with ``EmulatedLauncher(sanitize=sys.argv[1])``. It may use torch
    and everything that tests import; what it finds in memory that torch allocated is watched as
    well. Starting it takes some seconds.

    Args:
        script: the program.
        sanitize: "address" or "undefined".

    Returns:
        Exit status (0 if nothing was found), and what the program and the sanitizer wrote.
    """
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]),
        # Python itself does not free everything at its end.
        "ASAN_OPTIONS": "detect_leaks=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
    }
    if sanitize == "address":
        environment["LD_PRELOAD"] = _preloaded()
    return subprocess.run(
        [sys.executable, "-c", script, sanitize],
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
        env=environment,
    )


def _preloaded() -> str:
    """The sanitizer, which must come first of all libraries, and the one that throws exceptions."""
    found = []
    for library in ("libasan.so", "libstdc++.so"):
        command = [compiler(), f"-print-file-name={library}"]
        path = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
        if not Path(path).is_absolute():
            pytest.skip(f"the C++ compiler of this machine has no {library}")
        found.append(path)
    return " ".join(found)
