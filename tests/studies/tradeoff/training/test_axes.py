"""Axes give the values that make sense for a base, and say why there are none."""

from gsfw.plugins.registry import installed
from gsfw.studies.tradeoff.training.axes import AXES, NAMES, limited
from gsfw.studies.tradeoff.training.base import find_base, singles


def recipes(*names, **given):
    base = find_base({"method": "3dgs", **given}, installed())
    found, left_out = singles(base, names or NAMES, installed())
    return {recipe.name: recipe.settings for recipe in found}, left_out


def test_a_base_has_every_value_below_its_own():
    found, left_out = recipes("sh_degree", "resolution", downscale="2", sh_degree="2")
    assert found == {
        "sh_degree=1": {"sh_degree": 1},
        "sh_degree=0": {"sh_degree": 0},
        "resolution 1/2": {"downscale": 4.0},
        "resolution 1/4": {"downscale": 8.0},
    }
    assert left_out == []


def test_every_axis_of_3dgs_has_values_that_resolve():
    found, left_out = recipes()
    assert left_out == []
    assert {"sh=adaptive", "cap 1/2", "budget=auto", "strategy=mcmc", "antialias=true"} <= set(
        found
    )
    assert {axis.name for axis in AXES} | {"steps"} == set(NAMES)


def test_what_makes_no_sense_is_left_out_with_the_reason():
    found, left_out = recipes("sh_degree", "cap", "strategy", strategy="none", sh_degree="0")
    assert found == {}
    assert [(item.axis, item.why) for item in left_out] == [
        ("sh_degree", "the colours are the same from everywhere already"),
        ("cap", "the strategy has no limit of Gaussians"),
        ("strategy", "it is between adc, error, mcmc"),
    ]


def test_settings_of_one_strategy_are_not_given_to_another():
    _, left = recipes("strategy", **{"strategy.refine_every": "50", "strategy.absgrad": "true"})
    assert [item.axis for item in left] == ["strategy=error", "strategy=mcmc"]
    assert all("'strategy.absgrad'" in item.why for item in left)


def test_a_limited_run_starts_with_no_more_at_random():
    values = {"random_points": 100_000}
    assert limited(values, "mcmc", 500) == {"strategy.budget": "500", "random_points": 500}
    assert limited({"random_points": 100}, "adc", 500) == {"strategy.budget": "500"}
