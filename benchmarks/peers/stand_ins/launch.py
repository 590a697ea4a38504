"""Runs a trainer that was written for CUDA on the CPU, without a change of its code.

    python benchmarks/peers/stand_ins/launch.py TRAIN_PY ARGUMENTS

The modules in this folder stand in for the trainer's CUDA extensions.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

from cuda_on_cpu import CudaOnCpu

if __name__ == "__main__":
    script = Path(sys.argv[1]).resolve()
    sys.argv = sys.argv[1:]
    # Before this folder, so that its own modules win; its extensions are not installed.
    sys.path.insert(0, str(script.parent))
    with CudaOnCpu():
        runpy.run_path(str(script), run_name="__main__")
