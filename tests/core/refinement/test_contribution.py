"""What part of the pictures every row makes up."""

import pytest
import torch
from support.looks import look
from support.states import assert_same_bits

from gsfw.core.refinement.contribution import Contributions


def gathered(num_rows, *looks):
    seen = Contributions(num_rows, torch.device("cpu"))
    for one in looks:
        seen.add(*one)
    return seen


def test_pictures_count_in_parts_of_their_pixels():
    seen = gathered(3, look([3.0, 0.0, 1.2]), look([1.5, 0.6, 1.2], views=(4,)))
    assert seen.largest.tolist() == pytest.approx([0.5, 0.1, 0.2])
    assert seen.mean.tolist() == pytest.approx([0.375, 0.05, 0.2])
    assert seen.num_views == 2


def test_views_of_one_step_count_as_much_as_views_of_several():
    together = gathered(2, look([[3.0, 0.5], [1.0, 2.0]], views=(0, 1)))
    apart = gathered(2, look([3.0, 0.5]), look([1.0, 2.0], views=(1,)))
    assert_same_bits(together.state_dict(), apart.state_dict())


def test_pictures_of_a_step_that_changed_nothing_do_not_count():
    seen = gathered(2, look([3.0, 0.6]), look([0.0, 0.0], views=(1,)))
    assert seen.mean.tolist() == pytest.approx([0.5, 0.1])


def test_a_view_that_comes_again_is_still_one_view():
    assert gathered(1, look([1.0]), look([1.0])).num_views == 1


def test_splats_are_counted_for_their_rows():
    seen = gathered(4, look([3.0, 0.6], rows=[2, 0], num_rows=4), look([0.0, 1.2, 0.0, 0.0]))
    assert seen.largest.tolist() == pytest.approx([0.1, 0.2, 0.5, 0.0])
    assert seen.mean.tolist() == pytest.approx([0.05, 0.1, 0.25, 0.0])


def test_a_restored_state_goes_on_and_is_a_copy():
    seen = gathered(2, look([3.0, 0.5]))
    again = Contributions.restored(seen.state_dict())
    for each in (seen, again):
        each.add(*look([1.0, 1.0], views=(3,)))
    assert_same_bits(seen.state_dict(), again.state_dict())
    assert seen.num_views == 2


def test_a_state_of_before_pictures_were_counted_apart_is_read():
    state = gathered(2, look([3.0, 0.6])).state_dict()
    del state["counted"]
    assert Contributions.restored(state).mean.tolist() == pytest.approx([0.5, 0.1])
