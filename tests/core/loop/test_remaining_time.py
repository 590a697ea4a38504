"""The remaining time follows from a model of growth, not from the rate of the moment."""

from pathlib import Path

import pytest

from gsfw.core.callback import RunInfo
from gsfw.core.loop.remaining_time import RemainingTime

GROWING = {
    "strategy.refine_every": 100, "strategy.refine_start": 500, "strategy.refine_stop": 5000,
}  # fmt: skip


def run(steps=10_000, settings=None, **facts) -> RunInfo:
    return RunInfo(
        Path(), "3dgs", "toy", steps, 0, settings or {}, facts.pop("protocol", {}), **facts
    )


def replay(info: RunInfo, seconds, until: int, gaussians=lambda step: 10_000) -> RemainingTime:
    """Tell the steps of a run up to ``until``; ``seconds`` gives the time of each."""
    remaining = RemainingTime(info)
    for step in range(10, until + 1, 10):
        remaining.observe(step, gaussians(step), 1.0, seconds(step))
    return remaining


def test_nothing_is_said_before_it_is_known():
    remaining = RemainingTime(run())
    assert remaining.seconds() is None
    remaining.observe(1, 10_000, 1.0, 30.0)
    assert remaining.seconds() is None, "the first step decodes images and warms up"


def test_steps_that_stay_as_they_are_take_as_long_again():
    remaining = replay(run(), lambda step: 0.1, 2500)
    assert remaining.seconds() == pytest.approx(750.0)


def test_a_growing_model_is_expected_to_grow_on_and_to_get_slower():
    def gaussians(step):
        return 10_000 + 20 * min(max(step - 500, 0), 4500)

    def seconds(step):
        return 0.02 * (gaussians(step) / 10_000) ** 0.5

    remaining = replay(run(settings=GROWING), seconds, 2500, gaussians)
    true = sum(seconds(step) for step in range(2500, 10_000))
    by_the_rate = 7500 * seconds(2500)
    assert remaining.seconds() == pytest.approx(true, rel=0.1)
    assert abs(by_the_rate / true - 1) > 0.25, "the rate of the moment was far off"


def test_a_limit_of_gaussians_ends_the_expected_growth():
    limited = {**GROWING, "strategy.max_gaussians": 60_000}
    free, bound = (
        replay(run(settings=settings), lambda step: 0.02, 2500, lambda step: 10_000 + 20 * step)
        for settings in (GROWING, limited)
    )
    assert bound.seconds() < free.seconds()


def test_the_first_pass_over_the_views_is_no_measure_of_the_rest():
    remaining = replay(run(views=300), lambda step: 0.5 if step <= 300 else 0.05, 350)
    assert remaining.seconds() == pytest.approx(9650 * 0.05)


def test_a_phase_that_is_yet_to_come_is_expected_to_cost_what_the_method_says():
    costs = ((0, 1.0), (1000, 2.0))
    before = replay(run(step_costs=costs), lambda step: 0.1, 500)
    assert before.seconds() == pytest.approx(500 * 0.1 + 9000 * 0.2, rel=0.05)
    within = replay(run(step_costs=costs), lambda step: 0.1 if step <= 1000 else 0.15, 1100)
    assert within.seconds() == pytest.approx(8900 * 0.15), "measured, it no longer matters"


def test_evaluations_of_a_sample_and_of_all_views_are_included():
    info = run(settings={"eval_every": 2500, "eval_views": 30}, protocol={"views": 200})
    remaining = replay(info, lambda step: 0.1, 2500)
    remaining.evaluated(2500, 15.0, 30)
    assert remaining.seconds() == pytest.approx(750.0 + 2 * 15.0 + 100.0)


def test_a_run_is_expected_to_cost_more_than_its_first_steps_as_it_grows():
    assert RemainingTime(run()).mean_cost(10_000) == pytest.approx(1.0)
    free = RemainingTime(run(settings=GROWING)).mean_cost(10_000)
    assert 1.4 < free < 2.0, "up to four times the rows, in half of the steps"
    limited = {**GROWING, "strategy.max_gaussians": 15_000}
    assert 1.1 < RemainingTime(run(settings=limited)).mean_cost(10_000) < 1.23
    by_pixels = run(settings={**GROWING, "strategy.per_pixel": 0.5}, view_pixels=30_000)
    alike = RemainingTime(run(settings=limited)).mean_cost(10_000)
    assert RemainingTime(by_pixels).mean_cost(10_000) == alike
    assert RemainingTime(by_pixels).mean_cost(20_000) == pytest.approx(1.0), "it has enough"
    stages = ((0, 4.0), (2500, 1.0))
    assert RemainingTime(run(image_stages=stages)).mean_cost(10_000) < 0.95


def test_the_usual_growth_is_that_of_a_whole_run_in_few_refinements_or_in_many():
    often = {**GROWING, "strategy.refine_every": 25}
    costs = [RemainingTime(run(settings=each)).mean_cost(10_000) for each in (GROWING, often)]
    assert costs[0] == pytest.approx(costs[1], rel=0.02)
