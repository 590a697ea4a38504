"""Builds OpenSplat for the CPU from a folder of its source, with the libtorch of pip's torch."""

from __future__ import annotations

import subprocess
from pathlib import Path

import torch

PACKAGES = (
    *("cmake", "g++", "ninja-build", "libopencv-dev"),
    *("nlohmann-json3-dev", "libnanoflann-dev", "libcxxopts-dev"),
)
"""Debian's names of what it needs besides torch."""
LAST_LINES = 20


def build_opensplat(source: Path, folder: Path) -> Path:
    """Build the program, or take the one that is there.

    All sources are compiled as one (a unity build), because torch's headers take most of the time.

    Args:
        source: of OpenSplat; not written to.
        folder: of the build.

    Raises:
        SystemExit: it does not build; shows the last lines and names what may be missing.
    """
    program = folder / "opensplat"
    if program.is_file():
        return program
    if not (source / "opensplat.cpp").is_file():
        raise SystemExit(
            f"{source} is not OpenSplat's source. Get it with: "
            "git clone https://github.com/pierotofy/OpenSplat"
        )
    folder.mkdir(parents=True, exist_ok=True)
    settings = {
        "GPU_RUNTIME": "CPU",
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_PREFIX_PATH": torch.utils.cmake_prefix_path,
        # Libraries that are installed are not downloaded.
        "FETCHCONTENT_TRY_FIND_PACKAGE_MODE": "ALWAYS",
        "CMAKE_UNITY_BUILD": "ON",
        "CMAKE_UNITY_BUILD_BATCH_SIZE": "0",
    }
    options = [f"-D{name}={value}" for name, value in settings.items()]
    _call(["cmake", "-S", str(source), "-B", str(folder), "-G", "Ninja", *options], folder)
    _call(["cmake", "--build", str(folder)], folder)
    return program


def _call(command: list[str], folder: Path) -> None:
    log = folder / "build.log"
    with log.open("a") as output:
        failed = subprocess.run(command, stdout=output, stderr=subprocess.STDOUT, check=False)
    if failed.returncode:
        tail = "\n".join(log.read_text(errors="replace").splitlines()[-LAST_LINES:])
        raise SystemExit(
            f"{tail}\nOpenSplat does not build; all of the output is in {log}.\n"
            f"On Debian it needs: apt install {' '.join(PACKAGES)}"
        )
