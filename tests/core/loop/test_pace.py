"""The pace of a run: exact, recorded as text, and never torn."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsfw.core.errors import ConfigError
from gsfw.core.loop.pace import FASTEST, SLOWEST, UNIT, Decision, Pace

# Functions of numbers alone; the checks of shapes draw random numbers, which hypothesis refuses.
pytestmark = pytest.mark.unchecked


@st.composite
def paces(draw) -> Pace:
    updates = sorted(draw(st.sets(st.integers(0, 500), max_size=6)))
    rates = [draw(st.integers(SLOWEST, 5 * UNIT)) for _ in updates]
    return Pace([Decision(*item) for item in zip(updates, rates, strict=True)])


def test_without_a_decision_an_update_is_a_step():
    assert [Pace().step(updates) for updates in (0, 1, 700)] == [0, 1, 700]
    assert Pace().span(12) == 1


@given(pace=paces())
def test_every_step_of_the_schedule_is_passed_once_and_in_order(pace):
    passed = 0
    for updates in range(600):
        assert pace.step(updates) == passed
        span = pace.span(updates)
        assert span >= 0
        passed += span


@given(pace=paces())
def test_a_recorded_pace_is_the_same_pace(pace):
    again = Pace.parse(pace.texts)
    assert again.decisions == pace.decisions
    assert [again.step(updates) for updates in range(600)] == [
        pace.step(updates) for updates in range(600)
    ]


def test_a_later_decision_leaves_earlier_steps_where_they_were():
    pace = Pace.parse(["10:2.000"])
    before = [pace.step(updates) for updates in range(21)]
    pace.decide(Decision(20, 500))
    assert [pace.step(updates) for updates in range(21)] == before
    assert pace.step(24) == before[20] + 2
    assert pace.hastens(15) is False


def test_a_pace_above_four_steps_an_update_adds_no_rows():
    pace = Pace.parse(["5:4.500", "9:1.000:all-views"])
    assert [pace.hastens(updates) for updates in (4, 5, 8, 9)] == [False, True, True, False]
    assert [pace.all_views(updates) for updates in (8, 9, 50)] == [False, True, True]


def test_haste_is_that_beyond_the_planned_pace():
    pace = Pace.parse(["0:8.000", "5:30.000", "9:33.000"])
    assert pace.planned == 8 * UNIT
    assert [pace.hastens(updates) for updates in (0, 5, 9)] == [False, False, True]


@pytest.mark.parametrize(
    "text",
    ["", "812", "812:1.25", "a:1.250", "5:0.000", f"5:{FASTEST}.000", "5:1.000:all", "-1:1.000"],
)
def test_a_damaged_record_is_refused_with_its_form(text):
    with pytest.raises(ConfigError, match="expected UPDATE:PACE such as"):
        Pace.parse([text])


def test_decisions_out_of_order_are_refused():
    with pytest.raises(ConfigError, match="in the order of their updates"):
        Pace.parse(["8:1.000", "8:2.000"])
