"""Growth that stops when it no longer pays, and pruning by contribution."""

from dataclasses import replace
from itertools import count

import pytest
import torch
from support.gaussians import gaussians, set_rows, table_of, toy_scene
from support.looks import look
from support.refining import StrategyRun
from support.resuming import resumes_to_the_same_bits
from support.states import assert_same_bits

from gsfw.core.config import StrategyConfig
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.refinement.budget import ROUNDS, Budget, BudgetSize, least_useful
from gsfw.core.refiner import GrowthLimits, RefineContext
from gsfw.core.render_settings import Statistic
from gsfw.strategies.adc import AdcConfig
from gsfw.strategies.error_growth import ErrorGrowthConfig
from gsfw.strategies.mcmc import McmcConfig

SETTINGS = AdcConfig(refine_start=0, refine_every=10, refine_stop=40, reset_every=0, budget_every=5)
CONTRIBUTION = frozenset({Statistic.CONTRIBUTION})
STRATEGIES = pytest.mark.parametrize(
    "config", [SETTINGS, ErrorGrowthConfig(refine_stop=40), McmcConfig(refine_stop=40)]
)
ONE_VIEW = toy_scene(camera_centers=torch.zeros(1, 3))


def control(config: StrategyConfig = SETTINGS, scene=ONE_VIEW, stop=40, **changes) -> Budget:
    config = replace(config, **changes)
    return Budget(BudgetSize.parse(config), config, scene, stop)


def advance(counts, done, table, model, steps=100, growth_due=False):
    """Let the budget act after ``done`` steps; rows that it has pruned."""
    context = RefineContext(
        *(done - 1, steps, table, model, torch.Generator(), GrowthLimits(), growth_due, {})
    )
    return counts.refine(context).get("pruned", 0)


def pruned(counts, contribution, steps=100, start=39):
    """Rows after all rounds of pruning, if contributions stay as they are."""
    model = gaussians(len(contribution))
    model.means.values.data[:, 0] = torch.arange(len(contribution))
    _, table = table_of(model)
    for step in range(start, steps):
        rows = model.means.values[:, 0].long()
        measured = torch.tensor(contribution)[rows].tolist()
        if counts.statistics(step):
            counts.observe(*look(measured, step=step, steps=steps), model)
        advance(counts, step + 1, table, model, steps)
    return model.means.values[:, 0].long().tolist()


def test_the_least_useful_rows_hold_less_than_a_share_together():
    scores = torch.tensor([5.0, 1.0, 0.0, 90.0, 4.0])
    assert least_useful(scores, 0.05).tolist() == [2, 1]
    assert least_useful(scores, 0.06).tolist() == [2, 1, 4]
    assert least_useful(torch.zeros(3), 0.5).tolist() == []


def test_rows_that_add_nothing_go_and_the_others_stay_in_their_order():
    kept = pruned(control(budget="auto"), [9.0, 0.0, 0.01, 8.0, 0.0, *[9.0] * 10])
    assert kept == [0, 3, *range(5, 15)]


def test_no_more_than_a_fifth_of_the_rows_goes_in_a_round():
    counts = control(budget="auto")
    assert pruned(counts, [0.0] * 5 + [9.0] * 5) == [5, 6, 7, 8, 9]
    assert [point["pruned"] for point in counts.report()["curve"]] == [2, 1, 1, 1]


def test_a_number_is_reached_in_rounds_of_equal_ratios():
    counts = control(budget="5")
    kept = pruned(counts, [float(value) for value in range(1, 81)])
    assert kept == [75, 76, 77, 78, 79]
    assert [point["num_gaussians"] for point in counts.report()["curve"]] == [40, 20, 10, 5]
    assert [point["step"] for point in counts.report()["curve"]] == [41, 46, 51, 56]


def test_a_number_that_is_large_enough_prunes_nothing():
    counts = control(budget="100")
    assert len(pruned(counts, [1.0] * 10)) == 10
    assert [point["pruned"] for point in counts.report()["curve"]] == [0] * ROUNDS


def test_a_run_that_is_too_short_for_its_rounds_still_ends_with_the_number():
    assert pruned(control(budget="2"), [1.0, 5.0, 4.0, 3.0, 0.5], steps=41) == [1, 2]
    model = gaussians(3)
    set_rows(model, [0.1, 0.9, 0.5])
    counts = control(budget="2")
    counts.observe(*look([1.0] * 3, step=9, steps=10), model)
    assert (
        advance(counts, 10, table_of(model)[1], model, steps=10) == 1
    )  # By opacity: no view was seen.
    assert model.opacities().tolist() == pytest.approx([0.9, 0.5])


def test_a_round_waits_for_every_view():
    counts, model = control(budget="auto", scene=toy_scene()), gaussians(2)
    _, table = table_of(model)
    for step, view in zip(range(39, 44), (0, 0, 0, 0, 1), strict=True):
        if counts.statistics(step):
            counts.observe(*look([6.0, 0.0 if view == 0 else 3.0], views=(view,), step=step), model)
        assert advance(counts, step + 1, table, model) == 0
    assert [point["step"] for point in counts.report()["curve"]] == [44]
    assert model.num_rows == 2  # The second row matters to the second view only.


def test_a_round_ends_although_a_sampler_leaves_views_out():
    counts = control(budget="auto", scene=toy_scene())
    pruned(counts, [1.0, 2.0], steps=60)  # One of two views; three pictures of each are enough.
    assert [point["step"] for point in counts.report()["curve"]] == [46, 52, 58]


def test_views_are_looked_at_only_while_it_serves_something():
    counts = control(budget="5")
    pruned(counts, [1.0] * 20, start=39, steps=40)
    assert counts.statistics(40) == CONTRIBUTION
    assert control(budget="5").statistics(20) == frozenset()
    assert control(budget="auto").statistics(20) == CONTRIBUTION
    pruned(counts, [1.0] * 20, start=40)
    assert not any(counts.statistics(step) for step in range(100))


def growing(counts, gains, contribution=0.006, added=10):
    """Refinements 10 steps apart, between each two of which the loss falls by one of ``gains``."""
    rows, loss, model = 100, 1.0, gaussians(100)
    _, table = table_of(model)
    counts.observe(*look([contribution] * rows, step=5, loss=loss), model)
    for number, gain in zip(count(1), gains, strict=False):
        loss -= gain
        counts.observe(
            *look([contribution] * rows, step=10 * number + 5, loss=loss, steps=200), model
        )
        advance(counts, 10 * (number + 1), table, model, 200, growth_due=True)
        if not counts.grows:
            break
        rows += added
        table.append(model.clone_rows(torch.arange(added)))
        counts.rows_edited()
    return counts.report()


def test_growth_stops_when_twice_in_a_row_it_brings_less_than_the_least_useful_cost():
    # A row makes up 0.001 of the picture: 0.2 times that is what leaving it out would cost.
    paying, poor = 11 * 10 * 0.2e-3 / 10, 9 * 10 * 0.2e-3 / 10 / 10
    report = growing(
        control(budget="auto", stop=None), [paying, paying, poor, paying, poor, poor, paying]
    )
    assert report["stopped_growing_at"] == 70
    assert report["why"] == "another Gaussian gains less than the least useful ones contribute"
    assert report["curve"][0]["gain_per_gaussian"] is None  # Nothing was added before.
    assert report["curve"][1]["gain_per_gaussian"] == pytest.approx(paying / 10, rel=1e-3)
    assert report["curve"][1]["cost_per_gaussian"] == pytest.approx(0.2e-3, rel=1e-3)
    assert [point["num_gaussians"] for point in report["curve"]] == [100, 110, 120, 130, 140, 150]


def test_under_a_number_growth_goes_on_as_long_as_there_is_room():
    counts = control(budget="1000", stop=None)
    assert growing(counts, [0.0] * 6)["stopped_growing_at"] is None
    model = gaussians(2)
    limits = counts.limits(0, model)
    assert [limits.most_rows(own) for own in (0, 500, 5000)] == [2000, 500, 2000]
    auto = control(budget="auto").limits(0, model)
    assert [auto.most_rows(own) for own in (0, 500)] == [0, 500]


def test_losses_before_a_reset_say_nothing_about_those_after_it():
    counts, model = control(budget="auto"), gaussians(1)
    counts.observe(*look([1.0], step=5, loss=0.1), model)
    counts.opacities_reset(19)
    counts.observe(*look([1.0], step=15, loss=0.9), model)
    advance(counts, 20, table_of(model)[1], model, growth_due=True)
    assert counts.report()["curve"] == []


def test_growth_stops_half_way_at_the_latest_and_does_not_begin_again():
    counts, model = control(budget="auto", stop=90), gaussians(2)
    _, table = table_of(model)
    for step in range(60):
        counts.observe(*look([1.0] * 2, step=step), model)
        advance(counts, step + 1, table, model)
        assert counts.grows == (step + 1 < 50)
    assert counts.report()["why"] == "half of the run is over"


@STRATEGIES
def test_without_a_budget_there_is_no_refiner_for_it(config):
    assert "budget" not in StrategyRun(config).state_dict()


@STRATEGIES
def test_a_checkpoint_without_a_budget_can_go_on_with_one(config):
    strategy = StrategyRun(replace(config, budget="auto"))
    strategy.load_state_dict(StrategyRun(config).state_dict())
    assert strategy.report()["curve"] == []


@pytest.mark.parametrize(
    "config",
    [
        replace(SETTINGS, refine_stop=60),
        McmcConfig(refine_start=0, refine_every=10, refine_stop=60, budget_every=5),
    ],
)
def test_rows_stay_as_they_are_while_views_are_looked_at(config):
    edited = {}
    for budget in ("none", "auto"):
        strategy = StrategyRun(replace(config, budget=budget))
        model = gaussians(4)
        set_rows(model, [0.001, 0.5, 0.5, 0.5], [0.01] * 4)
        _, table = table_of(model)
        generator = torch.Generator().manual_seed(0)
        edited[budget] = []
        for step in range(23, 32):  # Growth ends at 24, half-way, and the first looks begin.
            strategy.observe(*look([3.0] * model.num_rows, step=step, steps=48), model)
            if strategy.refine(step, 48, table, model, generator):
                edited[budget].append(step + 1)
    assert edited == {"none": [30], "auto": []}


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["adc", "error", "mcmc"])
def test_a_run_that_is_cut_off_while_it_looks_resumes_to_the_same_bits(tmp_path, strategy):
    summary = resumes_to_the_same_bits(
        tmp_path,
        *("method=spacetime", f"strategy={strategy}", "strategy.budget=100"),
        *("strategy.refine_start=0", "strategy.refine_every=3", "strategy.refine_stop=9"),
        *("strategy.budget_every=1", "rescale=false"),
    )
    state = read_checkpoint(RunFolder(tmp_path / "whole").checkpoint(10))["refiners"]["budget"]
    assert state["seen"] is not None
    assert summary["num_gaussians"] <= 100


def test_a_restored_control_goes_on_in_the_middle_of_growth():
    counts, again = control(budget="auto"), control(budget="auto")
    growing(counts, [0.1, 0.1])
    model = gaussians(120)
    counts.observe(*look([1.0] * 120, step=26, loss=0.5), model)
    again.load_state_dict(counts.state_dict())
    for each in (counts, again):
        each.observe(*look([2.0] * 120, step=27, loss=0.4), model)
        advance(each, 30, table_of(model)[1], model, growth_due=True)
    assert_same_bits(counts.state_dict(), again.state_dict())
    assert len(again.report()["curve"]) == 3
