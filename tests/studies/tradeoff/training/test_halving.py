"""Halving keeps what may reach the target at the least size, or what nothing beats."""

from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.training.axes import BASELINE, Choice, Recipe
from gsfw.studies.tradeoff.training.halving import (
    Tried,
    combinations,
    cost,
    kept,
    number_of_runs,
    survivors,
)


def tried(name, psnr, size, axis="cap"):
    return Tried(Recipe((Choice(axis, name),)), psnr, size)


ARMS = [
    tried("large", 29.0, 9e6),
    tried("small", 28.0, 1e6),
    tried("poor", 20.0, 2e6),
    tried("good", 28.5, 2e6),
]


def names(recipes):
    return [recipe.name for recipe in recipes]


def test_with_a_target_the_smallest_that_should_reach_it_come_first():
    found = survivors(ARMS, 3, Wish(psnr=30.0), gain=2.0)
    assert names(found) == ["small", "good", "large"]
    found = survivors(ARMS, 4, Wish(psnr=30.0), gain=1.5)
    assert names(found) == ["good", "large", "small", "poor"]


def test_where_none_should_reach_the_target_the_best_come_first():
    assert names(survivors(ARMS, 2, Wish(psnr=40.0), gain=2.0)) == ["large", "good"]


def test_what_is_too_large_comes_last():
    assert names(survivors(ARMS, 4, Wish(28.0, megabytes=5.0), 0.0))[-1] == "large"


def test_without_a_target_what_nothing_beats_comes_first():
    assert names(survivors(ARMS, 4, Wish(), 0.0)) == ["large", "good", "small", "poor"]


def test_the_order_in_which_they_were_tried_changes_nothing():
    for goal in (Wish(), Wish(psnr=30.0)):
        assert survivors(ARMS, 2, goal, 1.0) == survivors(ARMS[::-1], 2, goal, 1.0)


def test_only_what_paid_on_different_axes_is_combined():
    baseline = Tried(Recipe(), 29.0, 4e6)
    singles = [
        tried("cap 1/2", 28.9, 2e6),
        tried("cap 1/4", 28.0, 1e6),
        tried("sh 1", 28.8, 1.5e6, "sh"),
        tried("sh 2", 28.0, 3e6, "sh"),  # Beaten by the others.
    ]
    found = combinations(baseline, singles, Wish(psnr=28.6), gain=0.0)
    assert names(found) == ["cap 1/2 + sh 1", "cap 1/4 + sh 1"]
    assert found[0].choices[1].axis == "sh"
    assert combinations(baseline, singles[:2], Wish(), 0.0) == []
    # One axis may beat all of another by itself, and be better still with it.
    far = [tried("cap 1/8", 29.5, 0.5e6), *singles[2:]]
    assert names(combinations(baseline, far, Wish(), 0.0)) == ["cap 1/8 + sh 1"]
    assert BASELINE not in names(found)


def test_every_round_costs_about_the_same():
    assert [kept(count) for count in (12, 6, 5, 1)] == [6, 3, 2, 1]
    # The baseline at each length; then 12 quarters, 6 halves and 3 wholes.
    assert cost(8, (0.25, 0.5, 1.0)) == 1.75 + 3 + 3 + 3
    assert number_of_runs(8, 3) == 3 + 12 + 6 + 3
    assert cost(1, (1.0,)) == 2.0
