"""Statistics of a render."""

import torch

from gsfw.core.render_output import RenderStatistics


def statistics() -> RenderStatistics:
    return RenderStatistics(
        visible=torch.ones(1, 3, dtype=torch.bool),
        radii=torch.full((1, 3), 2.0),
        screen_gradient=torch.tensor([[1.0, float("nan"), 3.0]]),
    )


def test_statistics_of_a_finite_step_are_not_copied():
    found = statistics()
    assert found.where(torch.tensor(True)) is found


def test_statistics_of_a_step_that_is_not_finite_are_zeros():
    found = statistics().where(torch.tensor(False))
    assert found.screen_gradient is not None
    for values in (found.visible, found.radii, found.screen_gradient):
        assert not values.any()
    assert found.absgrad is None
