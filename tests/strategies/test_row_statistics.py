"""What views have seen of every row."""

import torch
from states import assert_same_bits

from gsfw.strategies.row_statistics import RowStatistics


def measured(seed=0, views=3, splats=4):
    generator = torch.Generator().manual_seed(seed)
    gradient = torch.rand(views, splats, generator=generator)
    radii = torch.rand(views, splats, generator=generator)
    visible = torch.rand(views, splats, generator=generator) < 0.6
    return gradient, radii, visible


def test_the_mean_is_over_the_views_that_saw_the_row():
    seen = RowStatistics(3, torch.device("cpu"))
    gradient = torch.tensor([[2.0, 5.0, 1.0], [4.0, 7.0, 1.0]])
    visible = torch.tensor([[True, False, False], [True, True, False]])
    radii = torch.tensor([[3.0, 9.0, 1.0], [2.0, 4.0, 1.0]])
    seen.add(gradient, radii, visible)
    seen.add(torch.tensor([[9.0, 1.0, 0.0]]), radii[:1], torch.tensor([[True, True, False]]))
    assert seen.mean_gradient.tolist() == [5.0, 4.0, 0.0]
    assert seen.largest_radius.tolist() == [3.0, 9.0, 0.0]


def test_views_of_one_step_weigh_as_much_as_views_of_several():
    together, apart = (RowStatistics(4, torch.device("cpu")) for _ in range(2))
    gradient, radii, visible = measured()
    together.add(gradient, radii, visible)
    for view in range(3):
        apart.add(*(values[view : view + 1] for values in (gradient, radii, visible)))
    torch.testing.assert_close(together.mean_gradient, apart.mean_gradient)
    assert torch.equal(together.largest_radius, apart.largest_radius)


def test_splats_are_counted_for_their_rows():
    partly, wholly = (RowStatistics(6, torch.device("cpu")) for _ in range(2))
    gradient, radii, visible = measured()
    rows = torch.tensor([5, 0, 3, 1])
    partly.add(gradient, radii, visible, rows)
    spread = [torch.zeros(3, 6, dtype=values.dtype) for values in (gradient, radii, visible)]
    for target, values in zip(spread, (gradient, radii, visible), strict=True):
        target[:, rows] = values
    wholly.add(*spread)
    assert_same_bits(partly.state_dict(), wholly.state_dict())


def test_a_restored_state_goes_on_and_is_a_copy():
    seen = RowStatistics(4, torch.device("cpu"))
    seen.add(*measured())
    restored = RowStatistics.restored(seen.state_dict(), torch.device("cpu"))
    seen.add(*measured(1))
    restored.add(*measured(1))
    assert_same_bits(seen.state_dict(), restored.state_dict())
