"""splat-transform (PlayCanvas, MIT): a converter that is not ours, to read what gsfw writes.

npm installs it on first use into a folder of the system's temporary files. The version is the last
one that runs on Node 18; it needs no install scripts.
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
FOLDER = Path(tempfile.gettempdir()) / f"gsfw-splat-transform-{VERSION}-{os.getuid()}"

needs_splat_transform = pytest.mark.skipif(
    shutil.which("npm") is None, reason="no npm on this machine; Debian's packages: nodejs, npm"
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


def splat_transform(source: Path, target: Path) -> str:
    """Convert a file; return the report.

    Raises:
        AssertionError: it refuses the file.
    """
    modules = npm_install(FOLDER, f"@playcanvas/splat-transform@{VERSION}")
    tool = modules / ".bin" / "splat-transform"
    command = [str(tool), "-w", "-g", "cpu", str(source), str(target)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, f"{result.stdout}\n{result.stderr}"
    return result.stdout
