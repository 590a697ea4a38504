"""Method dynamic3dgs: refusals, where it starts, and what happens when time moves on."""

from dataclasses import replace

import pytest
import torch
from support.moving_splats import moving_scene
from support.states import assert_same_bits

from gsfw.core.errors import ConfigError
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig
from gsfw.methods.dynamic3d.method import first_points, view_notes
from gsfw.methods.dynamic3d.model import TrackedGaussians


def start(scene=None, **settings):
    config = TrackedGaussiansConfig(steps=100, **settings)
    method = config.build()
    model = method.build_model(scene or moving_scene(), Operators(), torch.Generator(), None)
    assert isinstance(model, TrackedGaussians)
    return method, model, Optimizer(model, Operators(), OptimizerSettings())


def fill_moments(model: TrackedGaussians, optimizer: Optimizer) -> None:
    for name, column in model.columns().items():
        if column.trained:
            optimizer.moments(name)[0].first.fill_(1.0)


def test_one_view_at_each_time_is_refused_with_advice():
    with pytest.raises(ConfigError) as caught:
        TrackedGaussiansConfig().build().check_scene(
            moving_scene(camera_centers=torch.zeros(11, 3))
        )
    assert str(caught.value) == (
        "method 'dynamic3dgs' follows what several cameras see at each time, and 'toy' has 11 "
        "training views at 11 times.\nUse method=4dgs, 4d-rotor or spacetime."
    )


def test_views_that_go_back_in_time_are_refused_with_advice():
    method, model, optimizer = start()
    method.prepare(0, model, optimizer, 0.25)
    method.prepare(1, model, optimizer, 0.5)
    with pytest.raises(ConfigError) as caught:
        method.prepare(2, model, optimizer, 0.25)
    assert str(caught.value) == (
        "method 'dynamic3dgs' follows a scene from each time to the next, but step 2 shows time "
        "0.25 after 0.5: the sampler goes back.\n"
        "Use sampler=sequential, which is this method's own."
    )


def test_the_second_time_freezes_what_does_not_move():
    method, model, optimizer = start()
    method.prepare(0, model, optimizer, 0.0)
    assert not model.tracking
    assert all(rate > 0 for rate in optimizer.learning_rates(0).values())
    fill_moments(model, optimizer)
    method.prepare(30, model, optimizer, 0.1)
    assert model.tracking
    rates = optimizer.learning_rates(30)
    assert {name for name, rate in rates.items() if rate > 0} == {"means", "quats", "sh_dc"}
    for name in ("means", "quats"):
        assert not bool(optimizer.moments(name)[0].first.any()), name
    assert bool(optimizer.moments("sh_dc")[0].first.any())


def test_fixed_colours_are_frozen_too():
    method, model, optimizer = start(colors="fixed")
    method.prepare(0, model, optimizer, 0.0)
    method.prepare(30, model, optimizer, 0.1)
    rates = optimizer.learning_rates(30)
    assert {name for name, rate in rates.items() if rate > 0} == {"means", "quats"}


def test_rates_decay_within_each_time_and_start_anew():
    method, model, optimizer = start(scene=moving_scene(num_times=8))
    optim = TrackedGaussiansConfig().optim
    rate, decay = optim.tracked_means_lr * 2.0, optim.tracked_decay
    method.prepare(0, model, optimizer, 0.0)
    for first, time in ((30, 0.1), (40, 0.2)):
        for step, expected in ((first, rate), (first + 5, rate * decay**0.5)):
            method.prepare(step, model, optimizer, time)
            assert optimizer.learning_rates(step)["means"] == pytest.approx(expected)


def test_rates_decay_over_the_whole_of_a_time_where_other_times_are_held_out():
    """Of 21 times of the capture the sampler shows three, for 35 steps each after the first."""
    method, model, optimizer = start(scene=moving_scene(num_times=21))
    optim = TrackedGaussiansConfig().optim
    last = optim.tracked_means_lr * 2.0 * optim.tracked_decay
    for step, time in ((0, 0.0), (30, 0.5), (65, 1.0), (82, 1.0)):
        method.prepare(step, model, optimizer, time)
    assert optimizer.learning_rates(82)["means"] > 1.5 * last
    assert optimizer.learning_rates(100)["means"] == pytest.approx(last)


def test_a_step_in_the_middle_of_a_time_goes_on_with_it_after_a_resume():
    method, model, optimizer = start()
    for step, time in ((0, 0.0), (30, 0.1), (40, 0.2), (41, 0.2)):
        method.prepare(step, model, optimizer, time)
    again, fresh, new_optimizer = start()
    fresh.load_state_dict(model.state_dict())
    again.load_state_dict(method.state_dict())
    new_optimizer.load_state_dict(optimizer.state_dict())
    for made, step in ((again, 42), (method, 42)):
        made.prepare(step, fresh if made is again else model, optimizer, 0.2)
    again.prepare(42, fresh, new_optimizer, 0.2)
    assert new_optimizer.learning_rates(42) == optimizer.learning_rates(42)
    assert again.state_dict() == method.state_dict()
    assert_same_bits(dict(fresh.state_dict()), dict(model.state_dict()))


def test_only_points_of_the_first_time_are_started_from():
    times = torch.tensor([0.0, 0.02, 0.1, torch.nan, 0.04, 1.0])
    scene = moving_scene(6, num_times=11, point_times=times)
    found = first_points(scene)
    assert torch.equal(found.points, scene.points[[0, 1, 4]])
    assert torch.equal(found.point_colors, scene.point_colors[[0, 1, 4]])
    untimed = replace(scene, point_times=None)
    assert first_points(untimed) is untimed
    unknown = replace(scene, point_times=torch.full((6,), torch.nan))
    assert first_points(unknown) is unknown


def test_times_with_few_views_are_named_with_the_remedy():
    remedy = (
        "Hold out whole cameras (datamanager.eval_cameras=NAME, holdout=NAMES) or fewer images "
        "(holdout_every=N)."
    )
    assert view_notes({0.0: 5, 0.5: 5, 1.0: 5}) == view_notes({}) == ()
    assert view_notes({0.0: 4, 0.5: 5}) == (
        "method dynamic3dgs builds all Gaussians on the first time, which has 4 training views "
        f"where another time has 5. {remedy}",
    )
    assert view_notes({0.0: 5, 0.25: 3, 0.5: 2}) == (
        "2 of 3 times have fewer than 4 training views, the first of them time 0.25 with 3: method "
        f"dynamic3dgs follows only what several views show. {remedy}",
    )
