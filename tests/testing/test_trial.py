"""Tests of gsfw.testing.trial: equal states."""

import pytest
import torch

from gsfw.testing.trial import difference

LARGEST = torch.finfo(torch.float32).max


@pytest.mark.parametrize("values", [(torch.nan, 0.0), (torch.inf, LARGEST), (-torch.inf, -LARGEST)])
def test_what_is_not_finite_equals_no_number(values):
    first, second = ({"means": torch.tensor([1.0, value])} for value in values)
    assert difference(first, second) == "means differs"
    assert difference(first, {"means": first["means"].clone()}) == ""


def test_integers_flags_and_single_values_are_compared_too():
    state = {"rows": torch.arange(3), "on": torch.tensor(True), "none": torch.empty(0, 3)}
    assert difference(state, {key: value.clone() for key, value in state.items()}) == ""
    assert difference(state, {**state, "on": torch.tensor(False)}) == "on differs"
