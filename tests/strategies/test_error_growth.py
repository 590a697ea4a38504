"""Growth by error: where rows are added, how many, and when views are asked."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.error_looks import error_look
from support.gaussians import gaussians, set_rows, table_of, toy_scene
from support.refining import StrategyRun
from support.states import assert_same_bits

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.errors import ConfigError
from gsfw.core.refiner import GrowthLimits
from gsfw.core.render_settings import Statistic
from gsfw.strategies.error_growth import ErrorGrowthConfig
from gsfw.strategies.rounds import RefinementRounds

SETTINGS = ErrorGrowthConfig(
    refine_start=0, refine_every=10, refine_stop=31, views=4, per_pixel=1.0, early=1.0
)
"""Rounds after 10, 20 and 30 steps, each of which looks at the views of four."""
THIRDS = [0, 0, 1, 1, 2, 2]
"""Each splat fills two of the six pixels."""
LEFT_WRONG, RIGHT_TOO = [0.4] * 2 + [0.0] * 4, [0.4] * 2 + [0.0] * 2 + [0.9] * 2


def strategy(pixels=6, **changes):
    scene = toy_scene(view_pixels=pixels)
    return StrategyRun(replace(SETTINGS, **changes), scene)


def model_of(opacities=(0.5, 0.5, 0.5)):
    model = gaussians(len(opacities))
    set_rows(model, list(opacities), [0.1] * len(opacities))
    return model


def step_of(run, model, step, errors, view, **changes):
    """One step of training as the trainer calls it, without an edit of rows."""
    context, seen = error_look(errors, THIRDS, views=(view,), step=step, **changes)
    run.before_backward(context, model)
    run.observe(context, seen, model)


def refined(run, model, *views, seed=0, **changes):
    """Look at views in the last steps before the first round; edit rows; the edits."""
    for place, errors in enumerate(views):
        step_of(run, model, 10 - len(views) + place, errors, place, **changes)
    return run.edit(9, table_of(model)[1], model, torch.Generator().manual_seed(seed))


def test_rows_are_split_where_two_views_are_wrong_and_not_where_a_single_one_is():
    model = model_of()
    before = model.means.values.detach().clone()
    found = refined(strategy(), model, RIGHT_TOO, LEFT_WRONG, LEFT_WRONG)
    assert found == {"split": 1, "pruned": 0}
    assert torch.equal(model.means.values[:2], before[1:])
    halves = model.means.values[2:].detach()
    assert len(halves) == 2
    assert float((halves - before[0]).norm(dim=1).max()) < 0.5


def test_of_rows_with_equal_errors_the_one_with_the_larger_gradient_is_first():
    model = model_of()
    before = model.means.values.detach().clone()
    wrong = [0.4] * 6
    found = refined(strategy(pixels=4), model, wrong, wrong, gradient=[1e-4, 3e-4, 2e-4])
    assert found == {"split": 0, "pruned": 0}, "one row by the last round is none in the first"
    found = refined(strategy(pixels=6), model, wrong, wrong, gradient=[1e-4, 3e-4, 2e-4])
    assert found == {"split": 1, "pruned": 0}
    assert torch.equal(model.means.values[:2], before[[0, 2]])


def test_rows_without_an_error_or_without_a_gradient_do_not_grow():
    for errors, gradient in ([0.0] * 6, [1.0] * 3), ([0.4] * 6, [0.0] * 3):
        model = model_of()
        found = refined(strategy(100), model, errors, errors, gradient=gradient)
        assert found == {"split": 0, "pruned": 0}


def test_growth_ends_at_the_number_of_gaussians_per_pixel():
    run, model = strategy(pixels=24, per_pixel=0.5), model_of()
    counts = []
    for step in range(40):
        shown = [row % model.num_rows for row in range(6)]
        context, seen = error_look(
            [0.4] * 6, shown, views=(step % 4,), step=step, num_rows=model.num_rows,
            rows=list(range(max(shown) + 1)),
        )  # fmt: skip
        run.before_backward(context, model)
        run.observe(context, seen, model)
        run.edit(step, table_of(model)[1], model, torch.Generator().manual_seed(step))
        counts.append(model.num_rows)
    assert [counts[9], counts[19], counts[29], counts[39]] == [6, 9, 12, 12]


def test_early_growth_begins_faster():
    wrong, fast, even = [0.4] * 6, model_of(), model_of()
    refined(strategy(early=2.0), fast, wrong, wrong)
    refined(strategy(early=1.0), even, wrong, wrong)
    assert (fast.num_rows, even.num_rows) == (5, 4)


@pytest.mark.parametrize(
    ("changes", "limits"),
    [
        ({"max_gaussians": 4}, GrowthLimits()),
        ({}, GrowthLimits(max_rows=4)),
        ({"budget": "2"}, GrowthLimits()),
    ],
    ids=["max_gaussians", "limits of others", "twice a budget"],
)
def test_growth_never_exceeds_a_limit(changes, limits):
    run, model = strategy(pixels=1000, **changes), model_of()
    for place in range(2):
        step_of(run, model, 8 + place, [0.4] * 6, place)
    table, generator = table_of(model)[1], torch.Generator().manual_seed(0)
    run.refine(9, 100, table, model, generator, limits)
    assert model.num_rows == 4


def test_a_scene_of_unknown_size_grows_to_the_largest_number():
    model = model_of()
    refined(strategy(pixels=0, max_gaussians=6), model, [0.4] * 6, [0.4] * 6)
    assert model.num_rows == 4


def test_transparent_rows_are_removed_but_never_all():
    model = model_of((0.5, 0.001, 0.002))
    assert refined(strategy(pixels=0, max_gaussians=1), model) == {"split": 0, "pruned": 2}
    model = model_of((0.001, 0.003, 0.002))
    opaque = model.means.values[1].detach().clone()
    assert refined(strategy(pixels=0, max_gaussians=1), model) == {"split": 0, "pruned": 2}
    assert torch.equal(model.means.values[0], opaque)


def test_views_are_asked_in_the_last_steps_before_a_round_only():
    asked, run, model = [], strategy(), model_of()
    for step in range(60):
        context, _ = error_look([0.4] * 6, THIRDS, views=(step,), step=step)

        def contributions(weights, step=step, real=context.contributions):
            asked.append(step)
            return real(weights)

        run.before_backward(replace(context, contributions=contributions), model)
    assert asked == [6, 7, 8, 9, 16, 17, 18, 19, 26, 27, 28, 29]


def test_nothing_is_measured_once_growth_has_ended():
    run, model = strategy(), model_of()
    assert run.statistics(5) == {Statistic.SCREEN_GRADIENT}
    assert run.statistics(30) == frozenset()
    table, generator = table_of(model)[1], torch.Generator()
    step_of(run, model, 8, [0.4] * 6, 0)
    run.refine(8, 100, table, model, generator, GrowthLimits(may_grow=False))
    assert run.statistics(9) == frozenset()
    step_of(run, model, 9, [0.4] * 6, 1)
    assert run.state_dict()["error"]["errors"]["views"] == [0]


def test_a_change_of_rows_by_another_refiner_drops_what_was_gathered():
    run, model = strategy(), model_of()
    step_of(run, model, 8, [0.4] * 6, 0)
    for refiner in run:
        refiner.rows_edited()
    assert run.state_dict()["error"]["errors"] is None
    assert run.gathered() == {}


def test_a_restored_state_repeats_the_same_growth():
    whole, cut = strategy(), strategy()
    models = [model_of(), model_of()]
    for run, model in zip((whole, cut), models, strict=True):
        step_of(run, model, 7, RIGHT_TOO, 0)
        step_of(run, model, 8, LEFT_WRONG, 1)
    resumed = strategy()
    resumed.load_state_dict(cut.state_dict())
    for run, model in zip((whole, resumed), models, strict=True):
        step_of(run, model, 9, LEFT_WRONG, 2)
        found = run.edit(9, table_of(model)[1], model, torch.Generator().manual_seed(0))
        assert found == {"split": 1, "pruned": 0}
    assert_same_bits(*(dict(model.state_dict()) for model in models))
    assert_same_bits(whole.state_dict(), resumed.state_dict())
    assert whole.state_dict()["error"]["first"] == 3


def test_rounds_count_from_the_first_to_the_last():
    rounds = RefinementRounds(start=5, every=10, stop=41)
    due = [done for done in range(60) if rounds.due(done)]
    assert due == [10, 20, 30, 40]
    assert [rounds.progress(done) for done in due] == [0.25, 0.5, 0.75, 1.0]
    assert [step for step in range(60) if rounds.nears(step, 2)] == [8, 9, 18, 19, 28, 29, 38, 39]


def test_needs_a_rasterizer_that_weighs_contributions_and_rows_that_can_be_split():
    features = frozenset({Feature.SCREEN_GRADIENT, Feature.WEIGHTED_CONTRIBUTION})
    assert SETTINGS.needs() == Needs(features=features, densifiable=True)


def test_more_views_cannot_agree_than_are_asked():
    with pytest.raises(ConfigError) as caught:
        replace(SETTINGS, agreeing_views=5).check()
    assert caught.value.message == (
        "strategy.agreeing_views=5: expected at most strategy.views=4, the views that are asked."
    )
    assert caught.value.advice.startswith("Give strategy.views=5 or more")


@settings(max_examples=10)
@given(
    opacities=st.lists(st.sampled_from([0.001, 0.3, 0.9]), min_size=1, max_size=6),
    pixels=st.integers(0, 40),
    limit=st.integers(1, 12),
    early=st.sampled_from([1.0, 2.0, 5.0]),
)
def test_whatever_the_scene_rows_stay_within_the_limit_and_one_is_left(
    opacities, pixels, limit, early
):
    run = strategy(pixels=pixels, max_gaussians=limit, early=early)
    model, most = model_of(opacities), max(limit, len(opacities))
    for step in range(31):
        shown = [pixel % model.num_rows for pixel in range(6)]
        rows = list(range(max(shown) + 1))
        context, seen = error_look(
            [0.4] * 6, shown, views=(step,), step=step, rows=rows, num_rows=model.num_rows
        )
        run.before_backward(context, model)
        run.observe(context, seen, model)
        run.edit(step, table_of(model)[1], model, torch.Generator().manual_seed(step))
        assert 1 <= model.num_rows <= most
