"""Files of any size need memory for their splats and for one part."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "file_memory.py"
COUNT = 500_000
"""Splats: 140 MB of them, far more than a part (20 MB) and what a process needs now and then."""
COPY = 100
"""MB besides the splats that a copy of them, or of most of their values, would exceed."""


@pytest.mark.slow
def test_writing_and_reading_need_no_copy_of_the_splats():
    command = [sys.executable, str(SCRIPT), str(COUNT), "ply"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    form, _, held, writing, reading = run.stdout.splitlines()[2].split()
    assert (form, float(held)) == ("ply", COUNT * 280 / 1e6)
    assert float(writing) < COPY, run.stdout
    assert float(reading) < COPY, run.stdout
