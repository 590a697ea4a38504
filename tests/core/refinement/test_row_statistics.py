"""What views have seen of every row."""

import torch
from support.states import assert_same_bits

from gsfw.core.refinement.row_statistics import RowStatistics


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
    seen.add_views(gradient, radii, visible)
    seen.add_views(torch.tensor([[9.0, 1.0, 0.0]]), radii[:1], torch.tensor([[True, True, False]]))
    assert seen.mean_gradient.tolist() == [5.0, 4.0, 0.0]
    assert seen.largest_radius.tolist() == [3.0, 9.0, 0.0]


def test_views_of_one_step_weigh_as_much_as_views_of_several():
    together, apart = (RowStatistics(4, torch.device("cpu")) for _ in range(2))
    gradient, radii, visible = measured()
    together.add_views(gradient, radii, visible)
    for view in range(3):
        apart.add_views(*(values[view : view + 1] for values in (gradient, radii, visible)))
    torch.testing.assert_close(together.mean_gradient, apart.mean_gradient)
    assert torch.equal(together.largest_radius, apart.largest_radius)


def test_splats_are_counted_for_their_rows():
    partly, wholly = (RowStatistics(6, torch.device("cpu")) for _ in range(2))
    gradient, radii, visible = measured()
    rows = torch.tensor([5, 0, 3, 1])
    partly.add_views(gradient, radii, visible, rows)
    spread = [torch.zeros(3, 6, dtype=values.dtype) for values in (gradient, radii, visible)]
    for target, values in zip(spread, (gradient, radii, visible), strict=True):
        target[:, rows] = values
    wholly.add_views(*spread)
    assert_same_bits(partly.state_dict(), wholly.state_dict())


def test_time_gradients_are_those_of_the_whole_step_shared_among_the_views_that_saw_the_row():
    seen = RowStatistics(3, torch.device("cpu"))
    assert seen.mean_time_gradient is None
    # A step of three views in two batches: row 0 is in all of them, row 1 in the first only.
    of_step, observed = torch.tensor([2.0, 1.0, 0.0]), torch.tensor(True)
    for visible in ([[1, 1, 0]], [[1, 0, 0], [1, 0, 0]]):
        flags = torch.tensor(visible).bool()
        seen.add_views(torch.zeros(flags.shape), torch.zeros(flags.shape), flags)
        seen.add_time_gradient(of_step, len(flags), observed)
    assert seen.mean_time_gradient.tolist() == [2.0, 3.0, 0.0]


def test_a_step_that_was_not_finite_adds_no_time_gradient():
    seen = RowStatistics(2, torch.device("cpu"))
    seen.add_time_gradient(torch.tensor([float("nan"), float("inf")]), 1, torch.tensor(False))
    assert seen.mean_time_gradient.tolist() == [0.0, 0.0]


def test_nothing_is_read_where_a_gpu_would_have_to_be_waited_for():
    device = torch.device("meta")
    seen = RowStatistics(2, device)
    yes = torch.ones((), dtype=torch.bool, device=device)
    seen.add_time_gradient(torch.zeros(2, device=device), 3, yes)
    assert seen.mean_time_gradient.is_meta


def test_rows_that_are_copies_take_along_what_was_seen_of_their_originals():
    seen = RowStatistics(4, torch.device("cpu"))
    seen.add_views(*measured())
    rows = torch.tensor([2, 0, 2])
    assert torch.equal(seen.taken(rows).mean_gradient, seen.mean_gradient[rows])
    assert seen.taken(rows).state_dict().keys() == seen.state_dict().keys()


def test_a_restored_state_goes_on_and_is_a_copy():
    seen = RowStatistics(4, torch.device("cpu"))
    seen.add_views(*measured())
    seen.add_time_gradient(torch.ones(4), 3, torch.tensor(True))
    restored = RowStatistics.restored(seen.state_dict(), torch.device("cpu"))
    for statistics in (seen, restored):
        statistics.add_views(*measured(1))
        statistics.add_time_gradient(torch.full((4,), 2.0), 3, torch.tensor(True))
    assert_same_bits(seen.state_dict(), restored.state_dict())
