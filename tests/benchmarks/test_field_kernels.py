"""The comparison of temporal fields in kernels and in torch, but for the clock."""

import field_kernels
import pytest
import torch

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
def test_the_comparison_needs_a_gpu(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["field_kernels.py"])
    assert field_kernels.main() == 3
    assert capsys.readouterr().out == "there is no GPU to use: torch sees none\n"
