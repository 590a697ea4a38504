"""Method 4dgs: settings, refusals, and its two phases."""

from dataclasses import replace

import pytest
import torch
from support.moving_splats import moving_scene
from support.scenes import random_splats

from gsfw.core.errors import ConfigError
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.step_settings import step_settings
from gsfw.methods.gaussians4d.config import (
    DeformationConfig,
    HashConfig,
    HexPlaneConfig,
)
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve
from gsfw.strategies.adc import AdcConfig

TINY = DeformationConfig(
    hexplane=HexPlaneConfig(channels=2, resolution=2, width=4),
    hash=HashConfig(levels=1, coarsest=128, finest=128, log2_rows=4, width=4),
)


def time_cells(config: DeformationConfig, **capture) -> int:
    """Cells along time of the encoder that is built for a capture."""
    generator = torch.Generator().manual_seed(0)
    model = config.build().build_model(moving_scene(**capture), Operators(), generator, None)
    encoder = model.field.encoder
    if config.encoder == "hexplane":
        (cells,) = {len(plane) for plane in encoder.time}
    else:
        ((_, cells),) = encoder._sizes
    return cells


def build(config: DeformationConfig, initial=None):
    method = config.build()
    seeded = torch.Generator().manual_seed(config.seed)
    return method, method.build_model(moving_scene(), Operators(), seeded, initial)


def test_the_defaults_have_the_schedule_of_the_paper_and_the_changes_of_captured_scenes():
    config = DeformationConfig()
    config.check()
    assert (config.encoder, config.steps, config.coarse_steps) == ("hexplane", 23_000, 3000)
    assert (config.deform_opacity, config.deform_sh) == (True, False)
    rates = config.optim.field_rates(config.coarse_steps)
    assert [rates["grid"].at(step) for step in (2999, 3000)] == [0.0, 2.4e-2]
    assert rates["grid"].at(23_000) == pytest.approx(8e-4)
    assert rates["network"].at(3000) == 8e-4
    assert rates["network"].at(23_000) == pytest.approx(8e-5)
    assert step_settings(config)["coarse_steps"] == (3000, 0)
    assert step_settings(config)["optim.field_lr_steps"] == (20_000, 0)


def test_short_runs_have_squared_differences_until_the_field_can_move_things():
    assert resolved(steps=400).squared_steps == 500
    assert resolved(steps=2000).squared_steps == 1000


def resolved(**values: object) -> DeformationConfig:
    """The settings of a run with these values."""
    # Not of the built-in scene, which recommends a length of its own.
    data = {"data": "folder", "datamanager": "blender", "device": "cpu"}
    layer = Layer("test", {"method": "4dgs", **data, **values})
    config = resolve(installed(), [layer]).config
    assert isinstance(config, DeformationConfig)
    config.check()
    return config


@pytest.mark.parametrize("preset", ["default", "fast"])
def test_presets_of_wu_et_al_leave_opacities_alone_and_keep_the_share_of_coarse_steps(preset):
    config = resolved(preset=preset, steps=2300)
    assert isinstance(config.strategy, AdcConfig)
    assert config.strategy.reset_every == 0
    assert config.coarse_steps == 300
    assert config.squared_steps == 1150


def test_the_preset_of_yang_et_al_has_their_schedule():
    config = resolved(preset="mlp")
    adc = config.strategy
    assert isinstance(adc, AdcConfig)
    assert (config.steps, config.coarse_steps, config.ssim_weight) == (40_000, 3000, 0.2)
    assert (config.encoder, config.scale_change) == ("mlp", "sum")
    assert (config.squared_steps, config.squared_weight) == (20_000, 2.0)
    assert (adc.absgrad, adc.grow_absgrad) == (True, 7e-4)
    assert (adc.refine_stop, adc.reset_every) == (15_000, 0)
    assert adc.refine_start == pytest.approx(500, rel=0.01)
    assert adc.refine_every == pytest.approx(100, rel=0.01)
    assert config.optim.means_lr_steps == 30_000
    rate = config.optim.field_rates(config.coarse_steps)["network"]
    assert rate.at(3000) == 8e-4
    assert rate.at(40_000) == pytest.approx(8e-5)
    short = resolved(preset="mlp", steps=4000)
    assert (short.coarse_steps, short.optim.field_lr_steps) == (300, 3700)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"steps": 100, "coarse_steps": 100},
            "coarse_steps=100: expected less than steps=100, so that the field is trained.",
        ),
        (
            {"hexplane": HexPlaneConfig(multipliers=(1, 0))},
            "hexplane.multipliers=(1, 0): expected whole numbers of at least 1, such as 1,2.",
        ),
        (
            {"hexplane": HexPlaneConfig(times=1)},
            "hexplane.times=1: expected auto, 0, or a number of at least 2.",
        ),
        (
            {"hash": HashConfig(coarsest=64, finest=32)},
            "hash.finest=32: expected at least hash.coarsest=64.",
        ),
    ],
)
def test_values_that_do_not_fit_together_are_refused(settings, message):
    with pytest.raises(ConfigError) as caught:
        DeformationConfig(**settings).check()
    assert caught.value.message == message


def test_an_unknown_encoder_is_refused_by_name():
    with pytest.raises(ConfigError) as caught:
        resolve(installed(), [Layer("command line", {"method": "4dgs", "encoder": "planes"})])
    assert "encoder=planes: expected one of hexplane, mlp, hash" in str(caught.value)


def test_notes_say_what_a_random_start_costs_and_nothing_of_time():
    method = DeformationConfig(init="random", random_points=50).build()
    (note,) = method.notes(moving_scene())
    assert note.startswith("Starting from 50 random splats")
    assert DeformationConfig().build().notes(moving_scene()) == ()


def test_the_field_comes_in_after_the_coarse_steps():
    method, model = build(DeformationConfig(steps=30, coarse_steps=10))
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    assert model.deforming, "a model that is only looked at is deformed"
    phases = []
    for step in (0, 9, 10, 29):
        method.prepare(step, model, optimizer, None)
        rates = optimizer.learning_rates(step)
        phases.append((model.deforming, rates["grid"] > 0))
    assert phases == [(False, False)] * 2 + [(True, True)] * 2


def test_the_field_may_hide_rows_for_good_once_differences_are_absolute():
    method, model = build(DeformationConfig(steps=60, coarse_steps=10, squared_steps=30))
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    assert model.settled, "a model that is only looked at is settled"
    for step, settled in ((0, False), (29, False), (30, True), (59, True)):
        method.prepare(step, model, optimizer, None)
        assert model.settled == settled


def test_a_splat_file_keeps_its_degree_through_a_resume():
    config = DeformationConfig(init="somewhere.ply")
    method, model = build(config, initial=random_splats(7, degree=2))
    again = config.build()
    again.load_state_dict(method.state_dict())
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    again.prepare(0, model, optimizer, None)
    assert model.canonical.active_degree == 2


@pytest.mark.parametrize(
    ("views", "times", "cells"),
    [
        (100, 100, 25),  # One camera per time: four times share a cell.
        (216, 24, 48),  # Nine cameras per time: two cells for each time.
        (12, 6, 3),
        (5, 5, 2),  # No fewer than two, the first and the last time.
        (2000, 1000, 100),
    ],
)
@pytest.mark.parametrize("encoder", ["hexplane", "hash"])
def test_a_cell_of_time_has_four_views_to_determine_it(encoder, views, times, cells):
    config = replace(TINY, encoder=encoder)
    assert time_cells(config, camera_centers=torch.rand(views, 3), num_times=times) == cells


@pytest.mark.parametrize(("given", "cells"), [(7, 7), (0, 100)])
@pytest.mark.parametrize("encoder", ["hexplane", "hash"])
def test_a_given_number_of_time_cells_wins_and_0_is_one_per_captured_time(encoder, given, cells):
    config = replace(
        TINY,
        encoder=encoder,
        hexplane=replace(TINY.hexplane, times=given),
        hash=replace(TINY.hash, times=given),
    )
    assert time_cells(config, camera_centers=torch.rand(100, 3), num_times=100) == cells


@pytest.mark.parametrize(("width", "depth", "hidden"), [(32, 1, 32), (64, 2, 64), (16, 0, 0)])
def test_hidden_layers_of_quantities_are_as_wide_as_shared_ones(width, depth, hidden):
    sizes = HexPlaneConfig(channels=2, resolution=4, width=width, depth=depth)
    _, found = build(replace(TINY, hexplane=sizes))
    _, given = build(replace(TINY, hexplane=replace(sizes, head_width=hidden)))
    assert {k: v.shape for k, v in found.state_dict().items()} == {
        k: v.shape for k, v in given.state_dict().items()
    }
