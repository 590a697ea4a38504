"""Tests of gsfw.core.ranges."""

import math
from dataclasses import dataclass, field

import pytest

from gsfw.core.errors import ConfigError
from gsfw.core.ranges import Range, check_ranges, number
from gsfw.core.step_settings import steps_field


@dataclass
class Inner:
    every: int = steps_field(100, at_least=1, floor=50)
    rate: float = number(1e-3, at_least=0, below=math.inf)


@dataclass
class Outer:
    share: float = number(0.5, above=0, at_most=1)
    limit: int | None = number(3, at_least=1)
    free: float = -1.0
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    ("bounds", "phrase", "inside", "outside"),
    [
        (Range(at_least=1), "a number of at least 1", (1, 9), (0,)),
        (Range(above=0), "a number above 0", (0.1, math.inf), (0.0, -1)),
        (Range(at_most=5), "a number of at most 5", (-9, 5), (6,)),
        (Range(below=5), "a number below 5", (4,), (5,)),
        (Range(at_least=0, at_most=1), "a number from 0 to 1", (0, 1), (-0.1, 1.1)),
        (Range(above=0, below=1), "a number above 0 and below 1", (0.5,), (0, 1)),
        (Range(above=0, at_most=1), "a number above 0 and at most 1", (1,), (0, 2)),
        (Range(at_least=0, below=1), "a number of at least 0 and below 1", (0,), (1,)),
        (Range(at_least=0, below=math.inf), "a finite number of at least 0", (0,), (math.inf,)),
        (Range(above=0, below=math.inf), "a finite number above 0", (1,), (0, math.inf)),
        (Range(below=math.inf), "a finite number", (0,), (math.inf,)),
    ],
    ids=str,
)
def test_a_range_says_what_it_holds(bounds, phrase, inside, outside):
    assert str(bounds) == phrase
    assert all(value in bounds for value in inside)
    assert not any(value in bounds for value in (*outside, math.nan))


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (Outer(share=0.0), "a.share=0: expected a number above 0 and at most 1."),
        (Outer(limit=0), "a.limit=0: expected a number of at least 1."),
        (Outer(inner=Inner(every=0)), "a.inner.every=0: expected a number of at least 1."),
        (Outer(inner=Inner(rate=math.nan)), "a.inner.rate=nan: expected a finite number of at"),
    ],
)
def test_a_value_out_of_range_is_refused_by_its_dotted_key(config, said):
    with pytest.raises(ConfigError) as caught:
        check_ranges(config, "a.")
    assert str(caught.value).startswith(said)


def test_values_in_range_and_values_that_are_none_pass():
    check_ranges(Outer(limit=None))
    check_ranges(Inner(every=1))  # The floor is one of rescaling, not of what can be given.
