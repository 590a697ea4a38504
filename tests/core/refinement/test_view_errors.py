"""The errors of rows that several views agree on."""

import pytest
import torch
from support.error_looks import PIXELS, error_look
from support.states import assert_same_bits

from gsfw.core.refinement.view_errors import ViewErrors

HALVES = [0, 0, 0, 1, 1, 1]
"""The upper row of pixels shows splat 0, the lower one splat 1."""
NAN = float("nan")


def gathered(*contexts, agreeing=2, num_rows=2):
    errors = ViewErrors(num_rows, agreeing, torch.device("cpu"))
    for context in contexts:
        errors.add(context)
    return errors


def upper(error, view, **changes):
    return error_look([error] * 3 + [0.1] * 3, HALVES, views=(view,), **changes)[0]


def agreed(errors):
    """The agreed errors, as sums over pixels."""
    return [PIXELS * value for value in errors.agreed.tolist()]


def test_a_row_has_the_error_that_two_views_reach():
    errors = gathered(upper(0.5, 0), upper(0.2, 1), upper(0.4, 2))
    assert agreed(errors) == pytest.approx([3 * 0.4, 3 * 0.1])


def test_an_error_in_a_single_view_does_not_count():
    errors = gathered(upper(0.9, 0), upper(0.01, 1), upper(0.02, 2))
    assert agreed(errors) == pytest.approx([3 * 0.02, 3 * 0.1])


def test_one_view_suffices_where_one_has_to_agree():
    errors = gathered(upper(0.9, 0), upper(0.01, 1), agreeing=1)
    assert agreed(errors) == pytest.approx([3 * 0.9, 3 * 0.1])


def test_a_row_that_fewer_views_see_counts_with_the_least_of_theirs():
    first = error_look([0.3] * PIXELS, [0] * PIXELS, rows=[0], num_rows=3)[0]
    second = upper(0.2, 1, rows=[0, 1], num_rows=3)
    errors = gathered(first, second, agreeing=3, num_rows=3)
    # Row 0 is seen twice, row 1 once, row 2 never.
    assert agreed(errors) == pytest.approx([3 * 0.2, 3 * 0.1, 0.0])


def test_a_view_that_is_rendered_again_counts_once():
    errors = gathered(upper(0.9, 0), upper(0.8, 0), upper(0.1, 1))
    assert agreed(errors) == pytest.approx([3 * 0.1, 3 * 0.1])
    both = error_look([0.9] * PIXELS + [0.3] * PIXELS, HALVES, views=(0, 2))[0]
    errors.add(both)
    assert agreed(errors) == pytest.approx([3 * 0.3, 3 * 0.1])


def test_a_view_that_is_twice_in_a_batch_counts_once():
    twice = error_look([0.9] * PIXELS * 2, HALVES, views=(5, 5))[0]
    assert agreed(gathered(twice, upper(0.2, 1))) == pytest.approx([3 * 0.2, 3 * 0.1])


def test_views_of_one_step_count_as_much_as_views_of_several():
    values = ([0.5] * 3 + [0.1] * 3, [0.2] * 3 + [0.6] * 3)
    together = gathered(error_look([*values[0], *values[1]], HALVES, views=(0, 1))[0])
    apart = gathered(*(error_look(v, HALVES, views=(i,))[0] for i, v in enumerate(values)))
    assert_same_bits(together.state_dict(), apart.state_dict())


def test_splats_that_are_only_some_of_the_rows_count_for_these_rows():
    looks = [upper(0.5, view, rows=[3, 1], num_rows=4) for view in range(2)]
    assert agreed(gathered(*looks, num_rows=4)) == pytest.approx([0.0, 3 * 0.1, 0.0, 3 * 0.5])


def test_pixels_outside_a_mask_have_no_error():
    valid = [True, False, False, False, False, False]
    looks = [upper(0.5, view, valid=valid) for view in range(2)]
    assert agreed(gathered(*looks)) == pytest.approx([0.5, 0.0])


@pytest.mark.parametrize("bad", [NAN, float("inf")])
def test_an_image_that_is_not_finite_has_no_error(bad):
    good = [upper(0.5, view) for view in range(2)]
    spoiled = error_look([bad] + [0.9] * 5, HALVES, views=(2,))[0]
    assert agreed(gathered(*good, spoiled)) == pytest.approx([3 * 0.5, 3 * 0.1])


def test_the_size_of_an_image_has_no_effect():
    errors = [0.5] * 3 + [0.1] * 3
    small = gathered(*(error_look(errors, HALVES, views=(view,))[0] for view in range(2)))
    large = [error_look(errors * 2, HALVES * 2, views=(view,), height=4)[0] for view in range(2)]
    assert small.agreed.tolist() == pytest.approx([0.25, 0.05])
    assert gathered(*large).agreed.tolist() == pytest.approx([0.25, 0.05])


def test_a_restored_state_goes_on_and_is_a_copy():
    errors = gathered(upper(0.5, 0), upper(0.2, 1))
    restored = ViewErrors.restored(errors.state_dict())
    restored.add(upper(0.4, 2))
    assert agreed(errors) == pytest.approx([3 * 0.2, 3 * 0.1])
    errors.add(upper(0.4, 2))
    assert_same_bits(errors.state_dict(), restored.state_dict())
    assert agreed(restored) == pytest.approx([3 * 0.4, 3 * 0.1])
