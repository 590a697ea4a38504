"""Settings of method spacetime: defaults, presets and refusals."""

import pytest

from gsfw.core.capabilities import Feature
from gsfw.core.errors import ConfigError
from gsfw.core.step_settings import step_settings
from gsfw.methods.spacetime.config import SpacetimeConfig, SpacetimeOptim
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, Settings, resolve


def resolved(**values: object) -> Settings:
    layer = Layer("command line", {"method": "spacetime", "device": "cpu", **values})
    return resolve(installed(), [layer])


def test_preset_paper_is_that_of_the_paper():
    config = resolved(preset="paper", steps=30_000).config
    assert isinstance(config, SpacetimeConfig)
    assert (config.motion_order, config.spin, config.colors) == (3, True, "sh")
    assert config.motion == "full"
    assert (config.steps, config.ssim_weight, config.lifetime_reg) == (30_000, 0.2, 0.0)
    rates = config.optim.learning_rates(extent=2.0)
    assert rates["motion"].at(0) == pytest.approx(1.75 * rates["means"].at(0))
    assert rates["motion"].at(30_000) == pytest.approx(1.75 * rates["means"].at(30_000))
    constant = {name: rate.initial for name, rate in rates.items() if rate.final is None}
    assert constant == {
        "log_scales": 5e-3, "quats": 1e-3, "opacity_logits": 5e-2, "sh_dc": 2.5e-3,
        "sh_rest": 1.25e-4, "spins": 1e-4, "time_centers": 1e-4, "log_durations": 0.03,
        "features": 2.5e-3, "feature_rates": 1e-3, "decoder": 1e-4,
    }  # fmt: skip
    steps = step_settings(config)
    assert steps["optim.means_lr_steps"] == (30_000, 0)
    assert steps["squared_steps"] == (15_000, 0)
    assert config.squared_weight == 2.0
    assert (steps["motion_start"], steps["motion_every"]) == ((15_000, 0), (4000, 50))


def test_positions_that_do_not_move_leave_motion_constant():
    rates = SpacetimeOptim(means_lr=0.0).learning_rates(1.0)
    assert rates["motion"].at(0) == rates["motion"].at(30_000) == pytest.approx(2.8e-4)


def test_paths_learn_faster_in_short_runs():
    factors = [
        SpacetimeOptim(means_lr_steps=steps).learning_rates(1.0)["motion"].initial / 2.8e-4
        for steps in (100, 1200, 2400, 30_000)
    ]
    assert factors == pytest.approx([10.0, 4.0, 1.0, 1.0])


def test_a_factor_of_paths_that_is_no_factor_is_refused():
    with pytest.raises(ConfigError, match=r"motion_factor=0\.0: expected auto, or"):
        SpacetimeConfig(optim=SpacetimeOptim(motion_factor=0.0)).check()


def test_opacities_are_not_reset_unless_someone_asks():
    assert resolved().flat()["strategy.reset_every"] == 0
    assert resolved(preset="features").flat()["strategy.reset_every"] == 0
    assert resolved(**{"strategy.reset_every": 3000}).flat()["strategy.reset_every"] == 3000


def test_freetime_is_straight_paths_relocation_and_a_price_for_lasting():
    flat = resolved(preset="freetime").flat()
    assert (flat["motion_order"], flat["spin"], flat["lifetime_reg"]) == (1, False, 0.01)
    assert (flat["strategy"], flat["strategy.opacity_reg"]) == ("mcmc", 0.0)
    assert flat["strategy.gradient_share"] == 0.5


def test_rows_grow_by_their_time_gradient_too_wherever_adc_is_used():
    for values in ({}, {"preset": "features"}, {"preset": "freetime", "strategy": "adc"}):
        assert resolved(**values).flat()["strategy.grow_time_gradient"] == 5e-5


def test_features_ask_for_six_extra_channels():
    assert Feature.EXTRA not in SpacetimeConfig().needs().features
    needs = SpacetimeConfig(colors="features").needs()
    assert Feature.SH in needs.features
    assert (needs.channels, needs.extra_channels) == (3, 6)


def test_other_colours_are_refused_with_the_ones_there_are():
    with pytest.raises(ConfigError) as caught:
        resolved(colors="grey")
    assert "colors=grey: expected one of sh, features, found 'grey'." in str(caught.value)
