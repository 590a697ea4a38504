"""Method 4d-rotor: its settings, what it refuses, and where and when Gaussians start."""

import pytest
import torch
from support.moving_splats import moving_scene
from support.scenes import random_splats

from gsfw.core.capabilities import Feature
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.step_settings import step_settings
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig, SlicedGaussiansOptim
from gsfw.methods.rotor4d.method import min_duration
from gsfw.methods.rotor4d.model import SlicedGaussians


def model_of(
    config: SlicedGaussiansConfig, capture: Scene | None = None, initial: Splats | None = None
) -> SlicedGaussians:
    seeded = torch.Generator().manual_seed(config.seed)
    model = config.build().build_model(capture or moving_scene(), Operators(), seeded, initial)
    assert isinstance(model, SlicedGaussians)
    return model


def test_rates_are_those_of_static_gaussians_and_of_time():
    rates = SlicedGaussiansOptim(factor=1.0).learning_rates(extent=2.0)
    assert rates["means"].at(0) == pytest.approx(3.2e-4)
    assert rates["time_centers"].at(0) == pytest.approx(1.6e-4)
    assert rates["time_centers"].at(20_000) == pytest.approx(1.6e-6)
    assert (rates["time_quats"].initial, rates["log_durations"].initial) == (1e-3, 5e-3)
    assert set(model_of(SlicedGaussiansConfig()).columns()) <= set(rates)
    steps = step_settings(SlicedGaussiansConfig())
    assert steps["neighbors_every"] == (100, 50)
    assert steps["optim.means_lr_steps"] == (20_000, 0)
    assert Feature.COVARIANCES in SlicedGaussiansConfig().needs().features


def test_notes_do_not_say_that_time_is_ignored():
    method = SlicedGaussiansConfig().build()
    assert method.notes(moving_scene()) == ()
    assert "Starting from 100,000 random splats" in method.notes(moving_scene(0))[0]


def test_points_start_when_they_were_seen():
    points = torch.rand(8, 3)
    points[3] = points[0]
    times = torch.arange(8) / 7
    capture = moving_scene(points=points, point_colors=torch.rand(8, 3), point_times=times)
    centers = model_of(SlicedGaussiansConfig(), capture).time_centers.values
    assert torch.equal(centers.detach(), times[torch.tensor([0, 1, 2, 4, 5, 6, 7])])


@pytest.mark.parametrize(
    "settings", [{}, {"init": "random", "random_points": 30}], ids=["points", "random"]
)
def test_other_starts_are_spread_over_the_sequence(settings):
    capture = moving_scene(point_times=torch.full((30,), 0.5)) if settings else moving_scene()
    model = model_of(SlicedGaussiansConfig(init_duration=0.3, **settings), capture)
    centers = model.time_centers.values.detach()
    assert float(centers.min()) < 0.2
    assert float(centers.max()) > 0.8
    torch.testing.assert_close(model.log_durations.values.exp().detach(), torch.full((30,), 0.3))
    velocities = model._sliced().velocities
    assert float(velocities.detach().abs().max()) == 0.0


@pytest.mark.parametrize("rotation", ["rotor", "two-quaternions"])
def test_the_splats_of_a_file_are_there_at_every_time(rotation):
    given = random_splats(7, degree=2)
    model = model_of(SlicedGaussiansConfig(rotation=rotation), initial=given)
    assert given.scales is not None
    for time in (0.0, 0.5, 1.0):
        drawn = model.splats(torch.tensor(time))
        torch.testing.assert_close(drawn.means, given.means)
        torch.testing.assert_close(drawn.opacities, given.opacities, rtol=2e-3, atol=0)
        assert drawn.covariances is not None
        variances = torch.linalg.eigvalsh(drawn.covariances)
        torch.testing.assert_close(variances, given.scales.square().sort(1).values)


def test_the_degree_grows_with_the_step():
    config = SlicedGaussiansConfig()
    method, model = config.build(), model_of(config)
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    degrees = []
    for step in (0, 999, 2999):
        method.prepare(step, model, optimizer, None)
        degrees.append(model.canonical.active_degree)
    assert degrees == [0, 1, 3]
    assert model.active_bands() == 15


def test_the_shortest_life_is_half_the_time_between_images():
    assert min_duration(moving_scene()) == 0.05
    assert min_duration(moving_scene(num_times=2)) == 0.5
