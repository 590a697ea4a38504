"""Sessions of the GPU script that need no GPU: programs of NVIDIA's are stand-ins."""

import json
import os
import time
from pathlib import Path

from gpu_plan import full
from gpu_report import Report
from gpu_session import Session


def on_a_gpu(tmp_path: Path, *wanted: str) -> Session:
    """A session of the full plan, in which only these parts run."""
    deadline = time.monotonic() + 100.0
    return Session(full(None), Report(tmp_path), os.environ, tmp_path, deadline, wanted)


def stand_in(tmp_path: Path, monkeypatch, name: str, *lines: str) -> None:
    """A program of NVIDIA's that runs these lines of a shell instead."""
    program = tmp_path / name
    program.write_text("\n".join(["#!/bin/sh", *lines]))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")


def parts(tmp_path: Path) -> dict[str, dict]:
    return json.loads((tmp_path / "gpu.json").read_text())["parts"]
