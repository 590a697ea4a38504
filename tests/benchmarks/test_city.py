"""The benchmark of a generated city runs from its images to its seams."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "city.py"
SMALLEST = (
    *("tiles=2x1", "views=6", "width=32", "height=24", "points=500", "blocks=2"),
    *("steps=4", "coarse=2", "whole_steps=0", "limit_mb=6000", "limit=address"),
)


@pytest.mark.slow
def test_the_smallest_city_is_cut_trained_merged_and_measured(tmp_path):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(tmp_path), *SMALLEST],
        env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((tmp_path / "result.json").read_text())
    assert found["limit"].startswith("6000 MB (")
    assert set(found["blocks"]) == {"b0", "b1"}
    assert found["merged"]["seam_pixels"] > 0
    assert found["eval_budget"]["psnr"] <= found["eval"]["psnr"] + 1
    rows = found["blocks_under_limit"]["gaussians"]
    assert 900 < rows < 1100  # Those that have crossed a border count in two blocks, or none.
    assert found["eval"]["num_gaussians"] == rows
    assert "seams lose" in done.stdout
