"""Method spacetime: refusals, notes, and where and when Gaussians start."""

import pytest
import torch
from support.moving_splats import moving_scene
from support.refining import refine
from support.scenes import random_splats

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.table import SplatTable
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.spacetime.config import SpacetimeConfig
from gsfw.methods.spacetime.model import SpacetimeGaussians


def start(scene=None, initial=None, **settings):
    config = SpacetimeConfig(**settings)
    method, seeded = config.build(), torch.Generator().manual_seed(config.seed)
    model = method.build_model(scene or moving_scene(), Operators(), seeded, initial)
    assert isinstance(model, SpacetimeGaussians)
    return method, model


def values(model, name: str) -> torch.Tensor:
    return model.columns()[name].values.detach()


def test_a_random_start_says_so():
    (note,) = SpacetimeConfig(random_points=50).build().notes(moving_scene(0))
    assert note.startswith("Starting from 50 random splats (there are no points to use).")
    assert SpacetimeConfig().build().notes(moving_scene()) == (), "times are nothing to be noted"


def test_points_start_at_rest_for_most_of_the_sequence():
    scene = moving_scene(500)
    _, model = start(scene)
    assert not values(model, "motion").any()
    assert not values(model, "spins").any()
    torch.testing.assert_close(values(model, "log_durations").exp(), torch.full((500,), 0.7))
    centers = values(model, "time_centers")
    assert float(centers.min()) < 0.05
    assert float(centers.max()) > 0.95
    assert float(centers.mean()) == pytest.approx(0.5, abs=0.05)
    static = StaticGaussiansConfig(ignore_time=True).build()
    still = static.build_model(scene, Operators(), torch.Generator(), None)
    for name, column in still.columns().items():
        assert torch.equal(values(model, name), column.values.detach()), name


def test_points_whose_time_is_known_are_centred_there():
    points, times = torch.rand(8, 3), torch.linspace(0, 1, 8)
    points[3], points[5] = points[0], torch.nan
    scene = moving_scene(points=points, point_colors=torch.rand(8, 3), point_times=times)
    _, model = start(scene)
    firsts, times_found = values(model, "means")[:, 0], values(model, "time_centers")
    centers = dict(zip(firsts.tolist(), times_found.tolist(), strict=True))
    assert model.num_rows == 6
    for row in (0, 1, 2, 4, 6, 7):
        assert centers[float(points[row, 0])] == pytest.approx(float(times[row]))


@pytest.mark.parametrize("init", ["random", "auto"])
def test_random_splats_have_random_times(init):
    points = 30 if init == "random" else 0
    scene = moving_scene(points, point_times=torch.full((points,), 0.5))
    _, model = start(scene, init=init, random_points=100)
    assert model.num_rows == 100
    assert float(values(model, "time_centers").std()) > 0.2


def test_a_file_is_started_from_at_its_own_degree():
    method, model = start(initial=random_splats(7, degree=2), init="somewhere.ply")
    assert model.num_rows == 7
    assert len(values(model, "time_centers").unique()) == 7
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    method.prepare(0, model, optimizer, None)
    assert model.canonical.active_degree == 2
    method.prepare(2999, model, optimizer, None)
    assert model.canonical.active_degree == 3
    again = SpacetimeConfig().build()
    again.load_state_dict(method.state_dict())
    assert again.state_dict() == method.state_dict() == {"first_degree": 2}


def test_features_begin_as_the_colours():
    scene = moving_scene()
    _, model = start(scene, colors="features")
    torch.testing.assert_close(values(model, "features"), scene.point_colors)
    assert not values(model, "feature_rates").any()
    assert "sh_rest" not in model.columns()


def test_what_is_not_asked_for_has_no_columns():
    _, model = start(spin=False, motion_order=1)
    assert set(model.columns()) - {"means", "quats", "log_scales", "opacity_logits"} == {
        "sh_dc", "sh_rest", "time_centers", "log_durations", "motion",
    }  # fmt: skip
    assert values(model, "motion").shape == (30, 1, 3)


def test_rows_lose_parameters_of_time_at_the_steps_that_are_set():
    method, model = start(motion="adaptive", motion_start=3, motion_every=4)
    table = SplatTable(model, Optimizer(model, Operators(), OptimizerSettings()))
    (motion,) = method.refiners(moving_scene(), model)
    looked = [step + 1 for step in range(12) if refine(motion, step, table, model)]
    assert looked == [3, 7, 11]
    assert model.columns()["motion"].offsets.diff().tolist() == [0] * 30


def test_all_rows_keep_all_parameters_of_time_unless_asked_otherwise():
    method, model = start(motion_start=3, motion_every=4)
    assert method.refiners(moving_scene(), model) == ()
    assert model.columns()["motion"].offsets is None
    assert method.report() == {}
