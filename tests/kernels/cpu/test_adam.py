"""The fused step of Adam on the CPU: whole tables, and any number of threads."""

import pytest
import torch
from support.adam_tables import gradients, start, stepped
from support.states import assert_same_bits

from gsfw.core.operators import AdamSettings, AdamUpdate
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")

YES = torch.tensor(True)


@pytest.mark.parametrize("shape", [(16_000, 3), (2000, 24), (1000, 16, 3)])
def test_whole_tables_are_stepped_as_one_row_of_numbers(shape):
    values, moments = start(shape, torch.float32)
    flat, flat_moments = start((48_000,), torch.float32)
    flat.copy_(values.flatten())
    for gradient in gradients(values, 2):
        CpuOperators().adam_([AdamUpdate(values, gradient, moments, 0.01)], AdamSettings(), YES)
        CpuOperators().adam_(
            [AdamUpdate(flat, gradient.flatten(), flat_moments, 0.01)], AdamSettings(), YES
        )
    assert torch.equal(values.flatten(), flat)
    assert torch.equal(moments.second.flatten(), flat_moments.second)


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_any_number_of_threads_gives_the_same_bits(dtype, named, use_threads):
    results = []
    for threads in (1, 2, 5):
        use_threads(threads)
        results.append(stepped(CpuOperators(), (20_000, 7), dtype, named))
    for other in results[1:]:
        assert_same_bits(results[0], other)
