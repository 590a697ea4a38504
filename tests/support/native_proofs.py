"""Tests of native code run again only where something has changed that they depend on.

A test marked ``native(*folders)`` leaves a stamp in pytest's cache when it passes: a hash of its
own file, of the folders, of the helpers that compile, and of the compilers. It is skipped while the
hash is the same; ``pytest --cache-clear`` forgets all stamps.
"""

import hashlib
import os
import platform
import subprocess
from collections.abc import Generator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
HELPERS = ("tests/emulation", "tests/support/native_programs.py", "tests/support/cuda_stubs.py")
"""Files that every native test may use: compilers' flags are among them."""


def _stamp(item: pytest.Item) -> Path | None:
    """The file that exists once the test has passed as it is; ``None`` where nothing is kept."""
    mark, kept = item.get_closest_marker("native"), getattr(item.config, "cache", None)
    if mark is None or kept is None:
        return None
    own = str(item.path.relative_to(ROOT))
    parts = (item.nodeid, _compilers(), *(_content(name) for name in (own, *HELPERS, *mark.args)))
    folder: Path = kept.mkdir("native")
    return folder / hashlib.sha256("\0".join(parts).encode()).hexdigest()


@cache
def _content(name: str) -> str:
    """A hash of a file, or of all files below a folder."""
    path = ROOT / name
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    digest = hashlib.sha256()
    for file in files:
        if file.suffix not in {".so", ".pyc"}:
            digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return digest.hexdigest()


@cache
def _compilers() -> str:
    """What the compilers of this machine call themselves, and for which processor they compile."""
    said = [platform.machine(), os.environ.get("CXX", "c++")]
    for command in (said[1], "aarch64-linux-gnu-g++", "qemu-aarch64"):
        try:
            done = subprocess.run([command, "--version"], capture_output=True, check=False)
            said.append(done.stdout.decode(errors="replace"))
        except OSError:
            said.append(f"no {command}")
    try:
        said.append(metadata.version("nvidia-cuda-nvrtc"))
    except metadata.PackageNotFoundError:
        said.append("no nvrtc")
    return "\n".join(said)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a native test that has passed with the same sources and compilers."""
    stamp = _stamp(item)
    if stamp is not None and stamp.exists():
        pytest.skip("proven before with the same sources and compilers (pytest --cache-clear)")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Leave the stamp of a native test that has passed."""
    report = yield
    if report.when == "call" and report.passed:
        stamp = _stamp(item)
        if stamp is not None:
            stamp.touch()
    return report
