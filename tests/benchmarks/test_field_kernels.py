"""The comparison of temporal fields in kernels and in torch, but for the clock."""

import subprocess
import sys

import field_kernels
import pytest
import torch
from support.native_programs import ROOT

from gsfw.core.operators import Operators
from gsfw.kernels.cpu.operators import CpuOperators

CPU = torch.device("cpu")


@pytest.mark.parametrize("name", field_kernels.CASES)
def test_both_sides_of_a_comparison_compute_the_same(name):
    made = field_kernels.CASES[name]
    cases = [made(operators, 20, CPU) for operators in (CpuOperators(), Operators())]
    assert field_kernels.difference(*cases) < 1e-5
    other = made(Operators(), 20, CPU)
    with torch.no_grad():
        other.inputs[0].mul_(1.5)
    assert field_kernels.difference(other, cases[1]) > 1e-3, "a difference is seen"


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_the_comparison_needs_a_gpu():
    command = [sys.executable, str(ROOT / "benchmarks" / "field_kernels.py")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout.count("\n")) == (3, 1), ended.stderr
