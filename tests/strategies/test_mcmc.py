"""MCMC density control: relocation, growth, noise."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import EXTENT, context_of, gaussians, set_rows, table_of
from support.refining import StrategyRun
from support.scenes import random_splats
from support.states import assert_same_bits

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Statistic
from gsfw.core.splats import Splats
from gsfw.core.step_settings import step_settings
from gsfw.strategies.mcmc import McmcConfig, draw_rows

SETTINGS = McmcConfig(refine_start=0, refine_every=10, refine_stop=100, noise_lr=0.0, growth=0.0)


def strategy(**changes):
    return StrategyRun(replace(SETTINGS, **changes))


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def together(model, members):
    """Opacity of coincident rows: what is seen at their common centre."""
    return float(1 - (1 - model.opacities()[members]).prod())


def members_at(model, mean):
    return (model.means.values == mean).all(1)


def test_dead_rows_move_to_live_ones_and_the_image_stays():
    model = gaussians(6)
    set_rows(model, [0.9, 0.004, 0.001, 0.6, 0.005, 0.002], [0.1] * 6)
    means, opacities = model.means.values.detach().clone(), model.opacities()
    optimizer, table = table_of(model)
    counts = strategy().edit(9, table, model, generator())
    assert counts == {"relocated": 4, "added": 0}
    assert model.num_rows == 6
    total = 0
    for row in (0, 3):
        members = members_at(model, means[row])
        total += int(members.sum())
        assert together(model, members) == pytest.approx(float(opacities[row]), rel=1e-5)
        sizes = model.sizes()[members]
        assert bool((sizes == sizes[0]).all())
        (moments,) = optimizer.moments("means")
        if members.sum() > 1:
            assert float(sizes[0]) < 0.1
            assert not moments.first[members].any()
            assert not moments.second[members].any()
    assert total == 6


def test_rows_that_were_not_drawn_keep_values_and_moments():
    model = gaussians(3)
    set_rows(model, [0.99, 0.0051, 0.001], [0.1] * 3)
    before = {name: column.values.detach()[1].clone() for name, column in model.columns().items()}
    optimizer, table = table_of(model)
    strategy().edit(9, table, model, generator())
    for name, column in model.columns().items():
        assert torch.equal(column.values[1], before[name])
        assert bool((optimizer.moments(name)[0].first[1] == 1).all())


def test_where_no_row_is_alive_or_none_is_dead_nothing_moves():
    for opacities in ([0.001] * 3, [0.5] * 3):
        model = gaussians(3)
        set_rows(model, opacities)
        before = {name: value.clone() for name, value in model.state_dict().items()}
        counts = strategy().edit(9, table_of(model)[1], model, generator())
        assert counts == {"relocated": 0, "added": 0}
        assert_same_bits(dict(model.state_dict()), before)


def test_it_grows_by_a_share_up_to_the_limit():
    model = gaussians(40)
    set_rows(model, [0.5] * 40)
    _, table = table_of(model)
    mcmc = strategy(growth=0.05, cap_max=43)
    for expected in (42, 43, 43):
        mcmc.edit(9, table, model, generator())
        assert model.num_rows == expected


def test_growth_leaves_the_image_and_starts_fresh_moments():
    model = gaussians(4)
    set_rows(model, [0.9, 0.5, 0.3, 0.7], [0.1] * 4)
    means, opacities = model.means.values.detach().clone(), model.opacities()
    optimizer, table = table_of(model)
    counts = strategy(growth=3.0).edit(9, table, model, generator())
    assert counts == {"relocated": 0, "added": 12}
    for row in range(4):
        members = members_at(model, means[row])
        assert together(model, members) == pytest.approx(float(opacities[row]), rel=1e-5)
    assert not optimizer.moments("sh_dc")[0].first[4:].any()


def test_a_start_above_the_limit_stays_as_it_is():
    model = gaussians(8)
    set_rows(model, [0.5] * 8)
    strategy(growth=0.5, cap_max=5).edit(9, table_of(model)[1], model, generator())
    assert model.num_rows == 8


def test_noise_follows_the_learning_rate_of_positions_at_every_step():
    model = gaussians(5)
    set_rows(model, [0.001] * 5, [0.1] * 5)
    twin = gaussians(5)
    twin.load_state_dict(model.state_dict())
    _, table = table_of(model)
    assert strategy(noise_lr=5e5).edit(3, table, model, generator()) == {}
    twin.perturb_(5e5 * table.learning_rate("means", 3), generator(), Operators())
    assert table.learning_rate("means", 3) == pytest.approx(1.6e-4 * EXTENT, rel=1e-3)
    assert torch.equal(model.means.values, twin.means.values)
    assert not torch.equal(model.means.values, gaussians(5).means.values)


def test_opacities_and_scales_are_pulled_towards_zero():
    splats = random_splats(10)
    unseen = RenderStatistics(torch.ones(1, 10, dtype=torch.bool), torch.ones(1, 10))
    terms = strategy(opacity_reg=0.02, scale_reg=0.03).regularizers(
        context_of(unseen, 10, splats=splats)
    )
    assert splats.scales is not None
    torch.testing.assert_close(terms["opacity_reg"], 0.02 * splats.opacities.mean())
    torch.testing.assert_close(terms["scale_reg"], 0.03 * splats.scales.mean())
    covariances = torch.diag_embed(splats.scales**2)
    shaped = Splats(splats.means, splats.opacities, splats.colors, covariances=covariances)
    terms = strategy(scale_reg=0.03).regularizers(context_of(unseen, 10, splats=shaped))
    torch.testing.assert_close(terms["scale_reg"], 0.03 * splats.scales.mean())


def test_rows_are_drawn_in_proportion_to_their_weights_and_never_at_zero():
    weights = torch.tensor([0.0, 1.0, 0.0, 3.0, 0.0])
    drawn = draw_rows(weights, 40_000, generator()).bincount(minlength=5)
    assert drawn[[0, 2, 4]].tolist() == [0, 0, 0]
    assert float(drawn[3] / drawn[1]) == pytest.approx(3.0, rel=0.05)


def test_the_same_seed_gives_the_same_bits():
    outcomes = []
    for seed in (1, 1, 2):
        model = gaussians(30)
        set_rows(model, [0.001, 0.5, 0.9] * 10)
        _, table = table_of(model)
        strategy(noise_lr=5e5, growth=0.2).edit(9, table, model, generator(seed))
        outcomes.append(dict(model.state_dict()))
    assert_same_bits(outcomes[0], outcomes[1])
    assert not torch.equal(outcomes[0]["means.values"], outcomes[2]["means.values"])


def test_it_refines_only_when_it_is_time_and_keeps_no_state():
    mcmc = strategy(refine_start=20, refine_stop=50)
    model = gaussians(3)
    _, table = table_of(model)
    times = [step + 1 for step in range(100) if mcmc.edit(step, table, model, generator())]
    assert times == [30, 40]
    assert mcmc.gathered() == {}
    assert mcmc.statistics(0) == frozenset()
    assert SETTINGS.needs() == Needs(densifiable=True)


def seen_by(gradient, visible=None):
    values = torch.tensor([gradient])
    shown = (
        torch.ones_like(values, dtype=torch.bool) if visible is None else torch.tensor([visible])
    )
    return RenderStatistics(shown, torch.ones_like(values), screen_gradient=values)


def observed(mcmc, model, gradient, **measured):
    seen = seen_by(gradient, **measured)
    mcmc.observe(context_of(seen, model.num_rows), seen, model)


def test_gradients_are_gathered_only_where_rows_are_drawn_by_them():
    by_gradient = strategy(gradient_share=0.5)
    assert by_gradient.statistics(98) == {Statistic.SCREEN_GRADIENT}
    assert by_gradient.statistics(99) == frozenset()
    needs = replace(SETTINGS, gradient_share=0.5).needs()
    assert needs.features == {Feature.SCREEN_GRADIENT}
    usual = strategy()
    for mcmc, keys in ((usual, set()), (by_gradient, {"gradient", "views", "radius"})):
        observed(mcmc, gaussians(3), [1.0] * 3)
        assert set(mcmc.gathered()) == keys


def test_dead_rows_move_to_where_the_gradient_is_large():
    model = gaussians(400)
    set_rows(model, [0.2, 0.8, 0.5, 0.001] + [0.001] * 396)
    means = model.means.values.detach().clone()
    mcmc = strategy(gradient_share=0.5)
    observed(mcmc, model, [3.0, 1.0, 0.0, 100.0] + [0.0] * 396)  # Dead rows draw nothing.
    mcmc.edit(9, table_of(model)[1], model, generator())
    drawn = [(int(members_at(model, means[row]).sum()) - 1) / 397 for row in range(4)]
    # Half of the share of each of the gradients 3 and 1 and of the opacities 0.2, 0.8 and 0.5.
    expected = [0.5 * 3 / 4 + 0.5 * 0.2 / 1.5, 0.5 / 4 + 0.5 * 0.8 / 1.5, 0.5 * 0.5 / 1.5]
    assert drawn[:3] == pytest.approx(expected, abs=0.06)
    assert not members_at(model, means[3]).any()


def test_growth_after_a_relocation_draws_copies_as_it_does_their_originals():
    model = gaussians(4)
    set_rows(model, [0.001, 0.5, 0.5, 0.5])
    means = model.means.values.detach().clone()
    mcmc = strategy(gradient_share=1.0, growth=2.0)
    observed(mcmc, model, [0.0, 0.0, 0.0, 1.0])  # All that is new is a copy of the last row.
    counts = mcmc.edit(9, table_of(model)[1], model, generator())
    assert counts == {"relocated": 1, "added": 8}
    assert int(members_at(model, means[3]).sum()) == 10
    assert mcmc.gathered() == {}


def test_views_in_which_nothing_has_a_gradient_leave_the_drawing_to_opacity():
    model = gaussians(3)
    set_rows(model, [0.001, 0.5, 0.002])
    mcmc = strategy(gradient_share=1.0)
    observed(mcmc, model, [1.0, 0.0, 0.0])
    assert mcmc.edit(9, table_of(model)[1], model, generator())["relocated"] == 2
    model = gaussians(3)
    set_rows(model, [0.001, 0.5, 0.002])
    assert mcmc.edit(9, table_of(model)[1], model, generator())["relocated"] == 2


def test_two_batches_of_a_step_count_as_two_steps_of_one():
    apart, together = strategy(gradient_share=0.5), strategy(gradient_share=0.5)
    for gradient in ([1.0, 3.0], [2.0, 0.0]):
        observed(apart, gaussians(2), gradient)
        half = seen_by([value / 2 for value in gradient])
        together.observe(context_of(half, 2, share=0.5), half, gaussians(2))
    assert_same_bits(apart.state_dict(), together.state_dict())


def test_a_restored_strategy_draws_the_same():
    outcomes = []
    for restore in (False, True):
        model, mcmc = gaussians(30), strategy(gradient_share=0.5, growth=0.2)
        set_rows(model, [0.001, 0.5, 0.9] * 10)
        observed(mcmc, model, [0.1, 0.2, 0.3] * 10)
        if restore:
            state = mcmc.state_dict()
            mcmc = strategy(gradient_share=0.5, growth=0.2)
            mcmc.load_state_dict(state)
        mcmc.edit(9, table_of(model)[1], model, generator())
        outcomes.append(dict(model.state_dict()))
    assert_same_bits(outcomes[0], outcomes[1])


def test_the_defaults_are_those_of_the_paper():
    config = McmcConfig()
    assert step_settings(config) == {
        "refine_start": (500, 100), "refine_stop": (25_000, 0), "refine_every": (100, 20),
        "budget_every": (1500, 50),
    }  # fmt: skip
    assert (config.gradient_share, config.budget) == (0.0, "none")
    assert config.recommended == {"init_opacity": 0.5, "init_scale": 0.1}
