"""Origin: the machine and the versions that made a result."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

from gsfw.core.cores import cores
from gsfw.plugins.specs import PROJECT

SOURCE = Path(__file__).resolve().parents[1]
"""Folder of the repository, where gsfw runs from one; else of the installed package."""


def origin() -> dict[str, str | int | None]:
    """Everything besides settings that the time and the last bits of a result depend on."""
    return {
        "gsfw": metadata.version(PROJECT),
        "commit": _commit(),
        "torch": metadata.version("torch"),
        "python": platform.python_version(),
        "cpu": processor(),
        "cores": cores(),
    }


def _commit() -> str | None:
    """The commit of the source, with "-dirty" where files were edited; ``None`` without git."""
    if not (SOURCE / ".git").exists():  # Another project's repository may lie further up.
        return None
    command = ["git", "-C", str(SOURCE), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None


def processor() -> str:
    """Model of the processor, as the system names it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(named), "") or platform.processor() or platform.machine()
