"""Mean squared differences, against loops."""

import pytest
import torch

from gsfw.core.maths.variation import mean_squared_difference


def grid() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(2, 4, 5, 3, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_first_differences_are_those_of_a_loop(axis):
    cells = grid().movedim(axis, 0)
    squares = [(cells[i + 1] - cells[i]).square().flatten().tolist() for i in range(len(cells) - 1)]
    values = [value for row in squares for value in row]
    found = mean_squared_difference(grid(), axis)
    assert float(found) == pytest.approx(sum(values) / len(values))


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_second_differences_are_those_of_a_loop(axis):
    cells = grid().movedim(axis, 0)
    rows = [cells[i - 1] - 2 * cells[i] + cells[i + 1] for i in range(1, len(cells) - 1)]
    expected = torch.stack(rows).square().mean()
    torch.testing.assert_close(mean_squared_difference(grid(), axis, order=2), expected)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("axis", [1, 2])
def test_gradients_are_those_of_finite_differences(axis, order):
    cells = grid().requires_grad_()
    assert torch.autograd.gradcheck(lambda g: mean_squared_difference(g, axis, order), cells)


@pytest.mark.parametrize(("size", "order"), [(1, 1), (2, 2)])
def test_an_axis_too_short_to_differ_along_does_not_vary(size, order):
    found = mean_squared_difference(torch.rand(size, 4), 0, order)
    assert float(found) == 0
