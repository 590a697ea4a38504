"""Every view is compared with itself."""

from dataclasses import replace

import pytest
import torch
from support.looks import look
from support.scenes import front_camera
from support.states import assert_same_bits

from gsfw.core.batch import Batch
from gsfw.core.refinement.view_losses import ViewLosses


def visited(*visits):
    losses = ViewLosses()
    for step, views, loss in visits:
        losses.add(*look([[1.0]] * len(views), views=views, step=step, loss=loss))
    return losses


def test_a_hard_view_after_an_easy_one_is_no_loss():
    losses = visited((0, (0,), 0.1), (1, (1,), 0.9), (4, (0,), 0.06), (6, (1,), 0.8))
    assert losses.num_compared == 2
    assert losses.gain_per_step == pytest.approx((0.04 / 4 + 0.1 / 5) / 2)
    assert losses.mean_loss == pytest.approx((0.1 + 0.9 + 0.06 + 0.8) / 4)


def test_views_of_one_batch_are_compared_each_with_itself():
    losses = visited((0, (0,), 0.5), (1, (1,), 0.7), (2, (0, 1), 0.3))
    assert losses.gain_per_step == pytest.approx((0.2 / 2 + 0.4 / 1) / 2)


def test_cleared_means_begin_anew_and_what_is_forgotten_is_not_compared():
    losses = visited((0, (0,), 0.5))
    losses.clear()
    losses.add(*look([1.0], step=2, loss=0.3))
    assert (losses.num_compared, losses.mean_loss) == (1, pytest.approx(0.3))
    losses.forget()
    losses.add(*look([1.0], step=4, loss=0.9))
    assert (losses.num_compared, losses.gain_per_step) == (1, pytest.approx(0.1))


def test_a_step_that_was_not_finite_has_changed_nothing():
    losses = visited((0, (0,), 0.5), (2, (0,), float("nan")), (4, (0,), 0.3))
    assert losses.gain_per_step == pytest.approx((0.0 + 0.1) / 2)


def test_a_step_whose_statistics_are_zeros_has_changed_nothing():
    losses = visited((0, (0,), 0.5))
    losses.add(*look([0.0], step=2, loss=0.9))
    losses.add(*look([1.0], step=4, loss=0.3))
    assert losses.gain_per_step == pytest.approx((0.0 + 0.1) / 2)
    assert losses.mean_loss == pytest.approx((0.5 + 0.5 + 0.3) / 3)


def test_a_view_that_no_step_has_rendered_so_far_is_not_compared():
    losses = ViewLosses()
    losses.add(*look([0.0], step=0, loss=0.9))
    losses.add(*look([1.0], step=2, loss=0.5))
    losses.add(*look([1.0], step=4, loss=0.3))
    assert losses.gain_per_step * losses.num_compared == pytest.approx(0.1)
    assert losses.mean_loss == pytest.approx((0.5 + 0.3) / 2)


def test_pictures_of_another_size_are_not_compared():
    losses = visited((0, (0,), 0.1))
    context, statistics = look([1.0], step=1, loss=0.4)
    images = torch.zeros(1, 4, 6, 3)
    larger = Batch(images, front_camera(6, 4), (0,))
    rendered = replace(context.rendered, color=images, alpha=images[..., :1])
    losses.add(replace(context, batch=larger, rendered=rendered, target=images + 0.4), statistics)
    assert losses.num_compared == 0


def test_pixels_that_are_masked_do_not_count():
    context, statistics = look([1.0], loss=0.3)
    valid = torch.zeros_like(context.target[..., :1], dtype=torch.bool)
    valid[0, 0] = True
    target = torch.where(valid, context.target, 99.0)
    losses = ViewLosses()
    losses.add(
        replace(context, batch=replace(context.batch, mask=valid), target=target), statistics
    )
    assert losses.mean_loss == pytest.approx(0.3)


def test_restored_losses_go_on():
    losses, again = visited((0, (0,), 0.5), (1, (0,), 0.4)), ViewLosses()
    again.load_state_dict(losses.state_dict())
    for each in (losses, again):
        each.add(*look([1.0], step=2, loss=0.1))
    assert_same_bits(losses.state_dict(), again.state_dict())
