"""What the sanitizers find in emulated kernels."""

import pytest
from emulation.sanitizers import run_sanitized

PROGRAM = """
import ctypes
import sys
from pathlib import Path

import torch
import emulation.launcher
from emulation.launcher import EmulatedLauncher, EmulationError
from gsfw.kernels.cuda.launcher import Kernel, address

class ArrayJob(ctypes.Structure):
    _fields_ = [
        ("count", ctypes.c_int64), ("input", ctypes.c_void_p), ("output", ctypes.c_void_p)
    ]

folder = Path(emulation.launcher.__file__).parent / "kernels"
launcher = EmulatedLauncher(3, sanitize=sys.argv[1], folders=[folder])

def run(source, expression, count, output):
    job = ArrayJob(count, address(values), address(output))
    launcher.launch(Kernel(source, expression), 3, 128, job)
    return output

values = torch.arange(384.0)
"""


@pytest.mark.native("kernels/cuda")
@pytest.mark.slow
@pytest.mark.parametrize("sanitize", ["address", "undefined"])
def test_right_kernels_pass_and_deadlocks_are_still_found(sanitize: str) -> None:
    program = """
assert run("collectives.cu", "block_sums<float>", 384, torch.zeros(3)).sum() == values.sum()
assert run("memory.cu", "look_around", 127, torch.zeros(1)) == 1.0
try:
    run("faults.cu", "early_return", 20, torch.zeros(384, dtype=torch.int32))
except EmulationError as error:
    assert "a deadlock" in str(error)
run("faults.cu", "early_return", 32, torch.zeros(384, dtype=torch.int32))
print("right")
"""
    done = run_sanitized(PROGRAM + program, sanitize)
    assert (done.returncode, done.stdout) == (0, "right\n"), done.stderr


FAULTS = [
    (
        "address",
        'run("collectives.cu", "block_sums<float>", 385, torch.zeros(2))',
        ["heap-buffer-overflow", "WRITE of size 4", "block_sums<float>"],
    ),
    (
        "address",
        'run("memory.cu", "look_around", 128, torch.zeros(1))',
        ["global-buffer-overflow", "READ of size 4", "look_around"],
    ),
    (
        "address",
        'run("memory.cu", "look_within", 128, torch.zeros(1))',
        ["global-buffer-overflow", "READ of size 4", "look<float>"],
    ),
    (
        "undefined",
        'run("memory.cu", "copy_fours", 1, torch.zeros(1536))',
        ["memory.cu", "misaligned address", "float4"],
    ),
]


@pytest.mark.native("kernels/cuda")
@pytest.mark.slow
@pytest.mark.parametrize(("sanitize", "program", "report"), FAULTS)
def test_a_fault_of_memory_is_found(sanitize: str, program: str, report: list[str]) -> None:
    done = run_sanitized(PROGRAM + program, sanitize)
    assert done.returncode != 0
    for words in report:
        assert words in done.stderr
