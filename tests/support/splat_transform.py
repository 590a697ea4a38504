"""splat-transform (PlayCanvas, MIT): a converter that is not ours, to read what gsfw writes.

npm installs it on first use into a folder of the system's temporary files. The usual version is the
last one that runs on Node 18; levels of detail need a later one. They need no install scripts.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

VERSION = "2.7.1"
WITH_LEVELS = "3.7.0"
"""A version that reads streamed SOG; it asks for Node 22, and runs on Node 20."""
NODE_WITH_LEVELS = 20

needs_splat_transform = pytest.mark.skipif(
    shutil.which("npm") is None, reason="no npm on this machine; Debian's packages: nodejs, npm"
)


def _node() -> int:
    """Major version of Node; 0 if there is none."""
    if shutil.which("npm") is None or shutil.which("node") is None:
        return 0
    said = subprocess.run(["node", "--version"], capture_output=True, text=True, check=True)
    return int(said.stdout.lstrip("v").partition(".")[0])


needs_splat_transform_with_levels = pytest.mark.skipif(
    _node() < NODE_WITH_LEVELS,
    reason=f"splat-transform {WITH_LEVELS} needs npm and Node {NODE_WITH_LEVELS} or newer",
)


def npm_install(folder: Path, *packages: str) -> Path:
    """Install npm packages into a folder, once for all processes; return node_modules."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = folder / "done"
        if not done.exists():
            command = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", *packages]
            subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
            done.touch()
    return folder / "node_modules"


def splat_transform(
    source: Path, target: Path, *, version: str = VERSION, level: int | None = None
) -> str:
    """Convert a file, or one level of a streamed SOG; return the report.

    Raises:
        AssertionError: it refuses the file.
    """
    folder = Path(tempfile.gettempdir()) / f"gsfw-splat-transform-{version}-{os.getuid()}"
    modules = npm_install(folder, f"@playcanvas/splat-transform@{version}")
    tool = modules / ".bin" / "splat-transform"
    levels = [] if level is None else ["--select-lod", str(level)]
    command = [str(tool), "-w", "-g", "cpu", *levels, str(source), str(target)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, f"{result.stdout}\n{result.stderr}"
    return result.stdout
