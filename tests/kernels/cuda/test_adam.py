"""The fused step of Adam of CUDA, emulated: many tables in one step, and any order of threads."""

import pytest
import torch
from support.adam_tables import gradients, start, stepped
from support.calls import Calls, CountedLauncher
from support.states import assert_same_bits
from torch import Tensor

from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate
from gsfw.kernels.cuda.operators import CudaOperators

YES = torch.tensor(True)


@pytest.mark.parametrize("named", [False, True])
def test_any_order_of_threads_gives_the_same_bits(operators_of, named):
    first, *others = (
        stepped(operators_of(seed), (700, 7), torch.float32, named) for seed in (0, 1, 2)
    )
    for other in others:
        assert_same_bits(first, other)


def updates_of_many(
    numbers: list[tuple[tuple[int, ...], torch.dtype]], some: Tensor
) -> list[AdamUpdate]:
    """Updates of tables of many kinds: every third one of some rows, every fifth one of a part."""
    updates = []
    for place, (shape, dtype) in enumerate(numbers):
        values, moments = start(shape, dtype)
        (gradient,) = gradients(values, 1)
        rows = some if place % 3 == 2 else None
        if place % 5 == 4:
            values, gradient = values[:, :2], gradient[:, :2]
            moments = AdamMoments(moments.first[:, :2], moments.second[:, :2], moments.count)
        updates.append(AdamUpdate(values, gradient, moments, 0.01 * (place + 1), rows))
    return updates


def test_tables_of_one_step_have_the_bits_of_steps_of_their_own(operators):
    shapes = [(11,), (300, 3), (40, 4), (37, 15, 3), (1500, 3)] * 4
    dtypes = [torch.float32, torch.float32, torch.float64]
    numbers = [(shape, dtypes[place % 3]) for place, shape in enumerate(shapes)]
    numbers += [((20, 3), torch.float32)] * 14
    some = torch.tensor([7, 0, 9])
    together, alone = (updates_of_many(numbers, some) for _ in range(2))
    operators.adam_(together, AdamSettings(), YES)
    for update in alone:
        operators.adam_([update], AdamSettings(), YES)
    for found, expected in zip(together, alone, strict=True):
        assert torch.equal(found.values, expected.values)
        assert torch.equal(found.moments.second, expected.moments.second)
        assert found.moments.count == expected.moments.count == 1


def test_the_tables_of_a_step_take_two_launches_and_one_allocation():
    updates = updates_of_many([((50, 3), torch.float32)] * 6, torch.tensor([1]))
    with Calls(launcher := CountedLauncher()) as calls:
        CudaOperators(launcher).adam_(updates, AdamSettings(), YES)
    assert calls.launches == ["begin_adam<float>", "adam<float>"]
    assert calls.operations == ["aten.new_empty.default"]
