"""Adaptive density control on cases worked out by hand."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import EXTENT, context_of, gaussians, set_rows, table_of, toy_scene
from support.refining import StrategyRun
from support.scenes import random_splats
from support.states import assert_same_bits

from gsfw.core.capabilities import Feature
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Statistic
from gsfw.core.sky import empty_sky
from gsfw.core.step_settings import step_settings
from gsfw.methods.gaussians3d.config import StaticGaussiansOptim
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.strategies.adc import AdcConfig

SETTINGS = AdcConfig(refine_start=0, refine_every=10, refine_stop=100, reset_every=0)
HIGH, LOW = 3e-4, 1e-4
SMALL, LARGE = 0.005 * EXTENT, 0.05 * EXTENT


def statistics(gradient, radii=None, visible=None) -> RenderStatistics:
    values = torch.tensor([gradient])
    seen = torch.ones_like(values, dtype=torch.bool) if visible is None else torch.tensor([visible])
    return RenderStatistics(
        seen,
        torch.ones_like(values) if radii is None else torch.tensor([radii]),
        screen_gradient=values,
        absgrad=10 * values,
    )


def strategy(**changes):
    return StrategyRun(replace(SETTINGS, **changes))


def generator():
    return torch.Generator().manual_seed(0)


def refined(adc, model, gradient, step=9, **measured):
    """Observe one view, refine, and say what was done."""
    optimizer, table = table_of(model)
    seen = statistics(gradient, **measured)
    adc.observe(context_of(seen, model.num_rows, step), seen, model)
    return adc.edit(step, table, model, generator()), optimizer


def test_small_rows_are_cloned_large_ones_split_and_transparent_ones_pruned():
    model = gaussians(6)
    set_rows(
        model, [0.5, 0.5, 0.5, 0.5, 0.0049, 0.0051], [SMALL, LARGE, SMALL, LARGE, SMALL, SMALL]
    )
    before = {name: column.values.detach().clone() for name, column in model.columns().items()}
    counts, optimizer = refined(strategy(), model, [HIGH, HIGH, LOW, LOW, LOW, HIGH])
    assert counts == {"cloned": 2, "split": 1, "pruned": 1}
    # Rows 0, 2, 3 and 5 stay; then the clones of 0 and 5; then the two halves of 1.
    origin = torch.tensor([0, 2, 3, 5, 0, 5, 1, 1])
    for name in ("quats", "opacity_logits", "sh_dc", "sh_rest"):
        assert torch.equal(model.columns()[name].values, before[name][origin])
    assert torch.equal(model.means.values[:6], before["means"][origin[:6]])
    assert torch.equal(model.log_scales.values[:6], before["log_scales"][origin[:6]])
    halves = model.log_scales.values[6:].detach().exp()
    torch.testing.assert_close(halves, torch.full((2, 3), LARGE / 1.6))
    assert not torch.equal(model.means.values[6], model.means.values[7])
    for name in model.columns():
        (moments,) = optimizer.moments(name)
        assert bool((moments.first[:4] == 1).all())
        assert not moments.first[4:].any()
        assert not moments.second[4:].any()


def test_the_gradient_is_averaged_over_the_views_that_saw_a_row():
    model = gaussians(3)
    set_rows(model, [0.5] * 3, [SMALL] * 3)
    adc = strategy()
    for gradient, visible in (
        ([HIGH, HIGH, HIGH], [True, True, True]),
        ([0.0, 0.0, HIGH], [True, False, True]),
    ):
        seen = statistics(gradient, visible=visible)
        adc.observe(context_of(seen, 3), seen, model)
    counts = adc.edit(9, table_of(model)[1], model, generator())
    assert counts == {"cloned": 2, "split": 0, "pruned": 0}  # All but row 0.


def test_several_views_in_a_step_count_as_much_as_one_in_several_steps():
    # In a step of two views each has half of the loss, and so half of the gradient.
    gradient, visible = torch.tensor([[HIGH, LOW], [LOW, HIGH]]), torch.ones(2, 2, dtype=torch.bool)
    radii = torch.ones(2, 2)
    apart, together, uneven = strategy(), strategy(), strategy()
    both = RenderStatistics(visible, radii, gradient / 2)
    together.observe(context_of(both, 2), both, gaussians(2))
    for view in range(2):
        one = RenderStatistics(visible[:1], radii[:1], gradient[view : view + 1])
        apart.observe(context_of(one, 2), one, gaussians(2))
        half = RenderStatistics(visible[:1], radii[:1], gradient[view : view + 1] / 2)
        uneven.observe(context_of(half, 2, share=0.5), half, gaussians(2))
    assert_same_bits(together.state_dict(), apart.state_dict())
    assert_same_bits(uneven.state_dict(), apart.state_dict())


def test_splats_that_are_only_some_of_the_rows_count_for_these_rows():
    adc = strategy()
    seen = statistics([HIGH, LOW])
    drawn = replace(random_splats(2), rows=torch.tensor([4, 1]))
    adc.observe(context_of(seen, 5, splats=drawn), seen, gaussians(5))
    assert adc.gathered()["views"].tolist() == [0, 1, 0, 0, 1]
    assert adc.gathered()["gradient"].tolist() == pytest.approx([0, LOW, 0, 0, HIGH])


def test_absgrad_has_a_threshold_of_its_own():
    model = gaussians(2)
    set_rows(model, [0.5, 0.5], [SMALL, SMALL])
    adc = strategy(absgrad=True)
    assert adc.statistics(0) == {Statistic.ABSGRAD}
    counts, _ = refined(adc, model, [HIGH / 10, LOW])  # Tenfold: 3e-4 and 1e-3.
    assert counts["cloned"] == 1
    assert replace(SETTINGS, absgrad=True).needs().features == {Feature.ABSGRAD}
    assert SETTINGS.needs().features == {Feature.SCREEN_GRADIENT}


def test_growth_stops_at_the_limit_and_takes_the_largest_gradients():
    model = gaussians(5)
    set_rows(model, [0.5] * 5, [SMALL] * 5)
    before = model.means.values.detach().clone()
    counts, _ = refined(strategy(max_gaussians=7), model, [HIGH, 5 * HIGH, 2 * HIGH, LOW, HIGH])
    assert counts["cloned"] == 2
    assert torch.equal(model.means.values[5:], before[[1, 2]])
    counts, _ = refined(strategy(max_gaussians=6), model, [HIGH] * 7)
    assert counts == {"cloned": 0, "split": 0, "pruned": 0}


@pytest.mark.parametrize(("step", "pruned"), [(19, 0), (29, 2)])
def test_large_rows_are_pruned_after_the_first_reset(step, pruned):
    model = gaussians(4)
    set_rows(model, [0.5] * 4, [SMALL, 0.11 * EXTENT, SMALL, SMALL])
    adc = strategy(reset_every=20, prune_radius=20.0)
    counts, _ = refined(adc, model, [LOW] * 4, step=step, radii=[1.0, 1, 21, 19])
    assert counts["pruned"] == pruned


@pytest.mark.parametrize("size", [SMALL, 0.11 * EXTENT])
def test_a_model_that_is_coarse_as_a_whole_keeps_its_large_rows(size):
    """A few random splats fill the scene: all of them were removed at the first reset."""
    model = gaussians(5)
    set_rows(model, [0.5] * 5, [0.11 * EXTENT] * 2 + [size] + [SMALL] * 2)
    adc = strategy(reset_every=20, prune_radius=20.0)
    most = size > SMALL
    radii = [21.0] * (2 + most) + [1.0] * (3 - most)
    counts, _ = refined(adc, model, [LOW] * 5, step=29, radii=radii)
    assert counts["pruned"] == (0 if most else 2)


def test_large_rows_of_the_sky_are_kept():
    """They are as large as the sky is far away: 3dgs would remove all of it at the first reset."""
    model = gaussians(6)
    set_rows(model, [0.5] * 6, [0.5 * EXTENT] * 2 + [SMALL] * 4)
    sky = empty_sky(torch.zeros(1, 3), EXTENT, torch.zeros(0, 3))
    with torch.no_grad():
        model.means.values[0] = torch.tensor([0.0, 0.0, sky.radius])
    config = replace(SETTINGS, reset_every=20)
    adc = StrategyRun(config, replace(toy_scene(), sky=sky))
    counts, _ = refined(adc, model, [LOW] * 6, step=29)
    assert counts["pruned"] == 1
    assert model.num_rows == 5
    assert model.means.values[0, 2] == sky.radius


def test_large_rows_stay_where_all_others_are_transparent():
    model = gaussians(10)
    set_rows(model, [0.5] * 4 + [0.001] * 6, [0.11 * EXTENT] * 4 + [SMALL] * 6)
    counts, _ = refined(strategy(reset_every=20), model, [LOW] * 10, step=29)
    assert counts["pruned"] == 6


def test_large_rows_stay_once_a_budget_has_ended_growth():
    """They are the background, and nothing would fill the hole."""
    model = gaussians(4)
    set_rows(model, [0.5, 0.001, 0.5, 0.5], [SMALL, SMALL, 0.11 * EXTENT, SMALL])
    adc = strategy(reset_every=20, budget="100", budget_every=1000)
    counts, _ = refined(adc, model, [LOW] * 4, step=59)
    assert counts["pruned"] == 1, "the transparent one"
    assert float(model.sizes().max()) > 0.1 * EXTENT


def test_split_children_are_not_pruned_for_the_radius_of_their_parent():
    model = gaussians(3)
    set_rows(model, [0.5] * 3, [LARGE, SMALL, SMALL])
    adc = strategy(reset_every=20, prune_radius=20.0)
    counts, _ = refined(adc, model, [HIGH, LOW, LOW], step=29, radii=[50.0, 50, 1])
    assert counts == {"cloned": 0, "split": 1, "pruned": 1}
    assert model.num_rows == 3


def test_a_reset_caps_opacities_and_forgets_their_moments():
    model = gaussians(4)
    set_rows(model, [0.5, 0.02, 0.006, 0.9], [SMALL] * 4)
    counts, optimizer = refined(strategy(reset_every=10), model, [LOW] * 4)
    assert counts == {"cloned": 0, "split": 0, "pruned": 0, "reset": 4}
    assert model.opacities().tolist() == pytest.approx([0.01, 0.01, 0.006, 0.01])
    assert not optimizer.moments("opacity_logits")[0].second.any()
    assert optimizer.moments("means")[0].second.all()


@pytest.mark.parametrize(("step", "reset"), [(39, 4), (89, 4), (99, 0)])
def test_there_is_no_reset_that_the_end_of_the_run_leaves_no_time_to_recover_from(step, reset):
    # A StrategyRun has 100 steps.
    model = gaussians(4)
    set_rows(model, [0.5] * 4, [SMALL] * 4)
    adc = strategy(reset_every=10, refine_stop=1000)
    assert refined(adc, model, [LOW] * 4, step=step)[0].get("reset", 0) == reset


def test_there_is_no_further_reset_while_nothing_has_come_back_from_the_last():
    model = gaussians(200)
    set_rows(model, [0.019] * 199 + [0.5], [SMALL] * 200)
    refined(strategy(reset_every=10), model, [LOW] * 200)
    assert float(model.opacities().max()) == pytest.approx(0.5)


def test_the_most_opaque_row_always_stays():
    model = gaussians(3)
    set_rows(model, [0.001, 0.003, 0.002], [SMALL] * 3)
    counts, _ = refined(strategy(), model, [LOW] * 3)
    assert counts["pruned"] == 2
    assert model.opacities().tolist() == pytest.approx([0.003])


def test_it_refines_only_when_it_is_time():
    adc = strategy(refine_start=20, refine_every=10, refine_stop=50)
    model = gaussians(2)
    set_rows(model, [0.5, 0.5], [SMALL, SMALL])
    _, table = table_of(model)
    times = []
    for step in range(100):
        seen = statistics([LOW] * 2)
        adc.observe(context_of(seen, 2, step), seen, model)
        if adc.edit(step, table, model, generator()):
            times.append(step + 1)
    assert times == [30, 40]
    assert adc.statistics(48) == {Statistic.SCREEN_GRADIENT}
    assert adc.statistics(49) == frozenset()
    assert adc.gathered() == {}


def test_gathering_begins_again_after_a_refinement():
    adc = strategy()
    model = gaussians(2)
    set_rows(model, [0.5, 0.5], [SMALL, SMALL])
    refined(adc, model, [HIGH, LOW])
    assert adc.gathered() == {}
    seen = statistics([LOW, LOW, HIGH])
    adc.observe(context_of(seen, 3), seen, model)
    assert adc.gathered()["views"].tolist() == [1, 1, 1]


def test_a_refinement_that_saw_no_view_still_prunes():
    model = gaussians(2)
    set_rows(model, [0.5, 0.001], [SMALL, SMALL])
    counts = strategy().edit(9, table_of(model)[1], model, generator())
    assert counts == {"cloned": 0, "split": 0, "pruned": 1}


class Fleeting(StaticGaussians):
    """Rows that are there for a given part of the sequence, and pull at their centres."""

    presence = torch.zeros(0)
    pull: torch.Tensor | None = None

    def lifetimes(self):
        return self.presence

    def time_gradients(self):
        return self.pull


def fleeting(presence, pull=None, sizes=None):
    """Opaque rows with these lifetimes, and time gradients of the step just taken."""
    count = len(presence)
    start = from_splats(random_splats(count, degree=1), 1)
    model = Fleeting(start, StaticGaussiansOptim().learning_rates(EXTENT))
    set_rows(model, [0.5] * count, sizes or [SMALL] * count)
    model.presence = torch.tensor(presence)
    model.pull = None if pull is None else torch.tensor(pull)
    return model


def moved_in_time(**changes):
    return strategy(grow_time_gradient=HIGH, **changes)


def test_rows_grow_by_their_time_gradient_and_split_where_they_are_large_or_last():
    presence, pull = [0.2, 0.9, 0.9, 0.2, 0.9, 0.2], [LOW, HIGH, LOW, HIGH, LOW, HIGH]
    gradient = [HIGH, LOW, HIGH, LOW, LOW, HIGH]
    sizes = [LARGE, SMALL, SMALL, LARGE, LARGE, SMALL]
    model = fleeting(presence, pull, sizes)
    before = model.sh_dc.values.detach().clone()
    counts, _ = refined(moved_in_time(), model, gradient)
    assert counts == {"cloned": 3, "split": 2, "pruned": 0}
    # Split: 0, large and pulled on the screen; 1, lasting and pulled in time. Cloned: 2, which
    # lasts but is pulled on the screen only; 3, large but pulled in time only; 5, neither.
    assert torch.equal(model.sh_dc.values, before[[2, 3, 4, 5, 2, 3, 5, 0, 1, 0, 1]])


def test_without_a_threshold_or_a_temporal_centre_nothing_grows_by_time():
    for model, adc in (
        (fleeting([0.9] * 3, [1.0] * 3), strategy()),
        (fleeting([0.9] * 3), moved_in_time()),
    ):
        seen = statistics([LOW] * 3)
        adc.observe(context_of(seen, 3), seen, model)
        assert "time_gradient" not in adc.gathered()
        counts = adc.edit(9, table_of(model)[1], model, generator())
        assert counts == {"cloned": 0, "split": 0, "pruned": 0}


def test_two_batches_of_a_step_count_as_two_steps_of_one_in_time():
    # Row 0 is in both views, which pull alike; row 1 in the first only, row 2 in the second.
    pulls = torch.tensor([[HIGH, LOW, 0.0], [HIGH, 0.0, HIGH]])
    batches, steps = moved_in_time(), moved_in_time()
    for view, visible in enumerate(([True, True, False], [True, False, True])):
        seen = statistics([LOW] * 3, visible=visible)
        half = replace(seen, screen_gradient=seen.screen_gradient / 2)
        both = fleeting([0.5] * 3, pulls.mean(0).tolist())
        batches.observe(context_of(half, 3, share=0.5), half, both)
        alone = fleeting([0.5] * 3, pulls[view].tolist())
        steps.observe(context_of(seen, 3), seen, alone)
    assert_same_bits(batches.state_dict(), steps.state_dict())


def test_a_step_that_was_not_finite_leaves_time_gradients_as_they_were():
    adc, nothing = moved_in_time(), statistics([0.0] * 2, visible=[False] * 2)
    model = fleeting([0.5] * 2, [float("nan"), HIGH])
    adc.observe(context_of(nothing, 2), nothing, model)
    assert adc.gathered()["time_gradient"].tolist() == [0.0, 0.0]


def test_near_the_limit_rows_compete_by_how_far_they_exceed_either_threshold():
    model = fleeting([0.2] * 3, [0.0, 4 * HIGH, 0.0])
    before = model.means.values.detach().clone()
    # The screen gradient has a threshold of 2e-4: row 0 exceeds it 3 times, row 2 1.5 times.
    refined(moved_in_time(max_gaussians=5), model, [2 * HIGH, LOW, HIGH])
    assert torch.equal(model.means.values[3:], before[[0, 1]])


def test_growth_ends_after_some_rounds_and_pruning_goes_on():
    adc, grown = strategy(max_rounds=2), []
    for done in (10, 20, 30, 40):
        model = gaussians(3)
        set_rows(model, [0.5, 0.5, 0.001], [SMALL] * 3)
        asked = bool(adc.statistics(done - 1))
        counts, _ = refined(adc, model, [HIGH, LOW, LOW], step=done - 1)
        assert counts["pruned"] == 1
        grown.append((asked, counts["cloned"]))
    assert grown == [(True, 1), (True, 1), (False, 0), (False, 0)]


def test_rounds_are_counted_from_the_first_refinement():
    adc = strategy(refine_start=35, max_rounds=1)
    assert [done for done in range(1, 100) if adc.statistics(done - 1)] == list(range(1, 41))


def test_radii_are_gathered_after_the_last_round_where_rows_are_pruned_by_them():
    adc = strategy(max_rounds=1, prune_radius=20.0, reset_every=20)
    model = gaussians(2)
    set_rows(model, [0.5, 0.5], [SMALL, SMALL])
    counts, _ = refined(adc, model, [HIGH, HIGH], step=29, radii=[1.0, 21.0])
    assert counts == {"cloned": 0, "split": 0, "pruned": 1}


def test_rows_that_are_there_for_less_than_some_times_of_the_capture_are_pruned():
    scene = toy_scene(num_times=21)
    model = fleeting([0.04, 0.05, 1.0])  # 0.84, 1.05 and 21 times.
    adc = StrategyRun(replace(SETTINGS, prune_lifetime=1.0), scene)
    counts, _ = refined(adc, model, [LOW] * 3)
    assert counts["pruned"] == 1
    model = gaussians(3)
    set_rows(model, [0.5] * 3)
    counts, _ = refined(adc, model, [LOW] * 3)  # Always there.
    assert counts["pruned"] == 0


def test_a_restored_strategy_goes_on_gathering_time_gradients():
    adc, again = moved_in_time(), moved_in_time()
    seen, model = statistics([LOW] * 2), fleeting([0.5] * 2, [HIGH, LOW])
    adc.observe(context_of(seen, 2), seen, model)
    again.load_state_dict(adc.state_dict())
    for strategy_ in (adc, again):
        strategy_.observe(context_of(seen, 2), seen, model)
    assert_same_bits(adc.state_dict(), again.state_dict())


def test_a_restored_strategy_does_the_same():
    outcomes = []
    for restore in (False, True):
        model, adc = gaussians(8), strategy()
        first, second = statistics([HIGH] * 4 + [LOW] * 4), statistics([HIGH, LOW] * 4)
        adc.observe(context_of(first, 8), first, model)
        if restore:
            state = adc.state_dict()
            adc = strategy()
            adc.load_state_dict(state)
        adc.observe(context_of(second, 8), second, model)
        adc.edit(9, table_of(model)[1], model, generator())
        outcomes.append(dict(model.state_dict()))
    assert_same_bits(outcomes[0], outcomes[1])


def test_the_defaults_are_those_of_the_paper():
    assert step_settings(AdcConfig()) == {
        "refine_start": (500, 100),
        "refine_stop": (15_000, 0),
        "refine_every": (100, 50),
        "reset_every": (3000, 300),
        "budget_every": (1500, 50),
        "guided.start": (1600, 0),
        "guided.every": (500, 50),
    }
    config = AdcConfig()
    assert config.budget == "none"
    assert (config.grow_time_gradient, config.prune_lifetime, config.max_rounds) == (0, 0, 0)
