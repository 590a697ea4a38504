"""Method 3dgs: settings, refusals, notes, losses and the SH schedule."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import no_contributions, no_views, toy_scene
from support.scenes import front_camera, random_splats
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.scene import Scene
from gsfw.core.step_settings import step_settings
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod


def model_of(config: StaticGaussiansConfig, capture: Scene | None = None, initial=None):
    method = config.build()
    seeded = torch.Generator().manual_seed(config.seed)
    return method, method.build_model(capture or toy_scene(30), Operators(), seeded, initial)


def test_the_defaults_are_those_of_the_paper():
    config = StaticGaussiansConfig()
    rates = config.optim.learning_rates(extent=2.0)
    assert rates["means"].at(0) == pytest.approx(3.2e-4)
    assert rates["means"].at(30_000) == pytest.approx(3.2e-6)
    constant = {name: rate.initial for name, rate in rates.items() if name != "means"}
    assert constant == {
        "log_scales": 5e-3, "quats": 1e-3, "opacity_logits": 5e-2, "sh_dc": 2.5e-3,
        "sh_rest": 1.25e-4,
    }  # fmt: skip
    assert (config.steps, config.sh_degree, config.ssim_weight) == (30_000, 3, 0.2)
    assert step_settings(config)["optim.means_lr_steps"] == (30_000, 0)
    assert step_settings(config)["sh_degree_interval"] == (1000, 0)
    assert {"fast", "default", "high"} == set(config.presets)


def test_a_start_without_points_is_refused():
    with pytest.raises(ConfigError) as caught:
        StaticGaussiansConfig(random_points=0).check()
    assert caught.value.message == "random_points=0: expected auto, or a number of at least 1."


def test_a_capture_that_moves_is_refused_with_advice():
    moving = toy_scene(num_times=12, time_range=(0.0, 1.0))
    with pytest.raises(ConfigError) as caught:
        StaticGaussiansConfig().build().check_scene(moving)
    assert str(caught.value) == (
        "this method is for static scenes, and 'toy' was captured at 12 different times.\n"
        "Use a dynamic method (gsfw plugins lists them), or ignore_time=true to train on all times "
        "as if they were one; what moves becomes blurred."
    )
    method = StaticGaussiansConfig().build()
    method.registered_as = "method 'mine' (gsfw-mine 0.1)"
    with pytest.raises(ConfigError, match=r"^method 'mine' \(gsfw-mine 0\.1\) is for static"):
        method.check_scene(moving)
    ignoring = StaticGaussiansConfig(ignore_time=True).build()
    ignoring.check_scene(moving)
    assert ignoring.notes(moving)[0] == "ignore_time=true: 12 times are treated as one."


def test_a_method_that_is_made_from_settings_alone_heeds_ignore_time():
    moving = toy_scene(num_times=12, time_range=(0.0, 1.0))
    StaticGaussiansMethod(StaticGaussiansConfig(ignore_time=True)).check_scene(moving)


@pytest.mark.parametrize(("init", "why"), [("auto", "there are no points"), ("random", "init=ran")])
def test_a_random_start_says_what_it_costs(init, why):
    capture = toy_scene(0 if init == "auto" else 30)
    config = StaticGaussiansConfig(init=init, random_points=500)
    method, model = model_of(config, capture)
    (note,) = method.notes(capture)
    assert note.startswith(f"Starting from 500 random splats ({why}")
    assert "0.6 dB with strategy=adc" in note
    assert "init=dense starts from surfaces" in note
    assert model.num_rows == 500


def test_a_random_start_follows_the_size_of_the_views():
    capture = replace(toy_scene(0), view_pixels=200 * 200)
    method, model = model_of(StaticGaussiansConfig(), capture)
    assert model.num_rows == 10_000
    assert method.notes(capture)[0].startswith("Starting from 10,000 random splats")


def test_a_region_that_the_cameras_do_not_show_is_mentioned():
    config = StaticGaussiansConfig(random_points=10, random_region="object")
    notes = config.build().notes(toy_scene(0))
    assert notes[1] == (
        "random_region=object: the cameras neither stand on a sphere nor look at one point; splats "
        "start among the cameras."
    )


def test_points_that_were_left_out_are_mentioned():
    points = torch.rand(8, 3)
    points[3], points[5] = points[0], torch.nan
    capture = toy_scene(points=points, point_colors=torch.rand(8, 3))
    method, model = model_of(StaticGaussiansConfig(), capture)
    assert method.notes(capture) == (
        "Left out 1 initial points: not finite.",
        "Left out 1 initial points: a copy of another.",
    )
    assert model.num_rows == 6


def test_a_file_is_started_from_at_its_own_degree():
    config = StaticGaussiansConfig(init="somewhere.ply")
    method, model = model_of(config, initial=random_splats(7, degree=2))
    assert model.num_rows == 7
    assert method.notes(toy_scene(30)) == ()
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    method.prepare(0, model, optimizer, None)
    assert model.active_degree == 2
    method.prepare(2999, model, optimizer, None)
    assert model.active_degree == 3


@pytest.mark.parametrize("interval", [1000, 0])
def test_the_degree_grows_with_the_step_alone(interval):
    method, model = model_of(StaticGaussiansConfig(sh_degree_interval=interval))
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    degrees = []
    for step in (0, 998, 999, 1999, 2999, 29_999):
        method.prepare(step, model, optimizer, None)
        degrees.append(model.active_degree)
    assert degrees == ([0, 0, 1, 2, 3, 3] if interval else [3] * 6)


def test_the_same_seed_gives_the_same_model():
    config = StaticGaussiansConfig(init="random", random_points=50)
    first, again = model_of(config)[1], model_of(config)[1]
    other = model_of(replace(config, seed=7))[1]
    for name, value in first.state_dict().items():
        assert torch.equal(value, again.state_dict()[name])
    assert not torch.equal(first.means.values, other.means.values)


def compared(step: int, time: float | None = None) -> tuple[StepContext, Tensor, Tensor, Tensor]:
    """The context of a step, and its rendered image, its target and its valid pixels."""
    generator = torch.Generator().manual_seed(0)
    images, rendered = (torch.rand(1, 12, 16, 3, generator=generator) for _ in range(2))
    valid = torch.rand(1, 12, 16, 1, generator=generator) < 0.5
    statistics = RenderStatistics(torch.ones(1, 4, dtype=torch.bool), torch.ones(1, 4))
    camera = front_camera(16, 12)
    if time is not None:
        camera = replace(camera, time=torch.tensor([time]))
    batch = Batch(images, camera, (0,), mask=valid)
    context = StepContext(
        step=step, steps=10, batch=batch, splats=random_splats(4),
        rendered=RenderOutput(rendered, torch.ones(1, 12, 16, 1), statistics), target=images,
        num_rows=4, share=1.0, extent=1.0, operators=Operators(),
        render=no_views, contributions=no_contributions,
    )  # fmt: skip
    return context, rendered, images, valid


def test_losses_are_weighted_l1_and_dssim_over_valid_pixels():
    context, *images = compared(step=0)
    losses = StaticGaussiansConfig(ssim_weight=0.25).build().losses(context)
    l1, dssim = Operators().l1_dssim(*images)
    assert set(losses) == {"l1", "dssim"}
    torch.testing.assert_close(losses["l1"], 0.75 * l1)
    torch.testing.assert_close(losses["dssim"], 0.25 * dssim)


def test_squared_differences_take_the_place_of_l1_before_squared_steps():
    settings = StaticGaussiansConfig(ssim_weight=0.25, squared_steps=5, squared_weight=3.0)
    method = settings.build()
    context, rendered, target, valid = compared(step=4)
    losses = method.losses(context)
    assert set(losses) == {"squared", "dssim"}
    squares = (rendered - target)[valid.expand_as(target)].square().mean()
    torch.testing.assert_close(losses["squared"], 0.75 * 3.0 * squares)
    torch.testing.assert_close(
        losses["dssim"], 0.25 * Operators().l1_dssim(rendered, target, valid)[1]
    )
    assert set(method.losses(compared(step=5)[0])) == {"l1", "dssim"}


def test_squared_differences_alone_need_no_ssim():
    losses = StaticGaussiansConfig(ssim_weight=0.0, squared_steps=5).build().losses(compared(0)[0])
    assert set(losses) == {"squared"}


def test_times_treated_as_one_are_averaged_to_the_end():
    method = StaticGaussiansConfig(ssim_weight=0.0, ignore_time=True).build()
    assert set(method.losses(compared(step=9, time=0.5)[0])) == {"squared"}
    assert set(method.losses(compared(step=9)[0])) == {"l1", "dssim"}
    moving = StaticGaussiansConfig(ssim_weight=0.0).build()
    assert set(moving.losses(compared(step=9, time=0.5)[0])) == {"l1", "dssim"}
