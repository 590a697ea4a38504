"""Sliced Gaussians: what is seen at a time, what is trained, and what strategies ask of them."""

import math

import pytest
import torch
from support.gaussians import no_contributions, no_views
from support.model_gradients import check_gradients, drawn
from support.scenes import front_camera, random_splats

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.core.table import SplatTable
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.rotor4d.config import SlicedGaussiansOptim
from gsfw.methods.rotor4d.model import (
    MAX_DURATION,
    SlicedGaussians,
)
from gsfw.methods.rotor4d.regularization import UNSEEN_SHARE, Regularization
from gsfw.methods.rotor4d.rotation import Rotation
from gsfw.methods.rotor4d.rotor import Rotor
from gsfw.methods.rotor4d.two_quaternions import TwoQuaternions
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

FORMS = pytest.mark.parametrize("form", [Rotor(), TwoQuaternions()], ids=["rotor", "quaternions"])
MIN_DURATION = 0.05


def gaussians(
    n: int = 20, form: Rotation | None = None, tilt: float = 0.5, **options
) -> SlicedGaussians:
    """Gaussians that move; ``tilt`` mixes space with time."""
    rates = SlicedGaussiansOptim().learning_rates(1.0)
    generator = torch.Generator().manual_seed(5)
    canonical = StaticGaussians(from_splats(random_splats(n, degree=1), 1), rates)
    settings = {
        "duration": 0.3,
        "min_duration": MIN_DURATION,
        "regularization": Regularization(1e-3, 0.2, 100),
    } | options
    centers = torch.rand(n, generator=generator)
    model = SlicedGaussians(canonical, centers, rates, form or Rotor(), CpuOperators(), **settings)
    with torch.no_grad():
        noise = torch.randn(n, 4, generator=generator)
        model.time_quats.values.add_(tilt * noise)
    model.project_()
    return model


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def at(time: float) -> torch.Tensor:
    return torch.tensor(time)


def draw(splats: Splats) -> torch.Tensor:
    camera = front_camera(dtype=splats.means.dtype)
    return ReferenceRasterizer().render(splats, camera, RenderSettings()).color


def space_time(model: SlicedGaussians, row: int) -> torch.Tensor:
    """The 4D covariance of a row."""
    rotations = model._rotation.matrices(model.canonical.quats.values, model.time_quats.values)
    scaled = rotations[:, :, row].detach() * model._scales()[row].detach()
    return scaled @ scaled.T


def regularized(model: SlicedGaussians, visible: torch.Tensor, time: float = 0.5, step: int = 0):
    splats = model.splats(at(time))
    statistics = RenderStatistics(visible[None], visible[None].float())
    image = torch.zeros(1, 4, 4, 3)
    context = StepContext(
        step=step, steps=10, batch=Batch(image, front_camera(4, 4), (0,)),
        splats=splats, rendered=RenderOutput(image, image[..., :1], statistics),
        target=image, num_rows=model.num_rows, share=1.0, extent=2.0, operators=Operators(),
        render=no_views,
        contributions=no_contributions,
    )  # fmt: skip
    model.refresh_neighbors_(step, context.extent)
    return model.regularizers(context)


# Drawing.


@FORMS
def test_a_slice_is_the_conditional_gaussian_at_its_time(form):
    model = gaussians(form=form, tilt=1.0).double()
    drawn = model.splats(at(0.4))
    rows = torch.arange(20) if drawn.rows is None else drawn.rows
    assert drawn.quats is None
    assert drawn.covariances is not None
    for position, row in enumerate(rows.tolist()):
        whole = space_time(model, row)
        elapsed = 0.4 - model.time_centers.values[row].detach()
        across = whole[:3, 3] / whole[3, 3]
        mean = model.canonical.means.values[row] + across * elapsed
        covariance = whole[:3, :3] - whole[3, 3] * across.outer(across)
        faded = model.canonical.opacities()[row] * torch.exp(-(elapsed**2) / (2 * whole[3, 3]))
        close = {"rtol": 1e-6, "atol": 1e-9}  # The time was given in float32.
        torch.testing.assert_close(drawn.means[position], mean, **close)
        torch.testing.assert_close(drawn.covariances[position], covariance, **close)
        torch.testing.assert_close(drawn.opacities[position], faded, **close)


@FORMS
@pytest.mark.parametrize("time", [0.0, 0.37, 1.0])
def test_without_tilt_and_end_they_are_static_gaussians(form, time):
    model = gaussians(form=form, tilt=0.0).double()
    with torch.no_grad():
        model.log_durations.values.fill_(math.log(1e8))
    expected = draw(random_splats(20, degree=1, dtype=torch.float64))
    torch.testing.assert_close(draw(model.canonical.splats()), expected, rtol=0, atol=1e-6)
    expected = draw(model.canonical.splats())
    torch.testing.assert_close(draw(model.splats(at(time))), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.5, 1.0])
def test_rows_that_are_left_out_would_not_have_been_seen(time, monkeypatch):
    model = gaussians(60, duration=0.1)
    drawn = model.splats(at(time))
    assert drawn.rows is not None
    assert 0 < len(drawn) < 60
    monkeypatch.setattr(SlicedGaussians, "_visible_rows", lambda self, time: None)
    everything = model.splats(at(time))
    assert everything.rows is None
    assert torch.equal(everything.means[drawn.rows], drawn.means)
    assert torch.equal(everything.opacities[drawn.rows], drawn.opacities)
    absent = torch.ones(60, dtype=torch.bool)
    absent[drawn.rows] = False
    assert float(everything.opacities[absent].detach().max()) < 1 / 255
    assert torch.equal(draw(everything), draw(drawn))


def test_no_time_is_the_beginning():
    model = gaussians()
    first, same = model.splats(at(0.0)), model.splats()
    assert torch.equal(first.means, same.means)
    assert torch.equal(first.opacities, same.opacities)


@pytest.mark.parametrize("time", [-3.0, -0.2, 1.2, 4.0])
def test_times_outside_of_the_sequence_have_slices_too(time):
    drawn = gaussians(duration=1.0).splats(at(time))
    for tensor in drawn.tensors().values():
        assert bool(tensor.isfinite().all())


def test_a_time_at_which_nothing_is_there_is_an_empty_image_with_gradients_of_zero():
    model = gaussians(duration=0.06)
    drawn = model.splats(at(50.0))
    assert len(drawn) == 0
    color = draw(drawn)
    assert not bool(color.any())
    terms = regularized(model, torch.zeros(0, dtype=torch.bool), 50.0)
    torch.stack([color.sum(), *terms.values()]).sum().backward()
    gradient = model.canonical.means.values.grad
    assert gradient is None or bool(gradient.isfinite().all())


@pytest.mark.parametrize("duration", [1e-8, 1e8])
@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_the_shortest_and_the_longest_are_finite_with_their_gradients(duration, tilt):
    model = gaussians(200, tilt=tilt)
    with torch.no_grad():
        model.log_durations.values.fill_(math.log(duration))
        model.time_centers.values[:50] = 0.5
    drawn = model.splats(at(0.5))
    assert len(drawn) >= 50
    assert drawn.covariances is not None
    total = drawn.means.sum() + drawn.opacities.sum() + drawn.covariances.sum()
    total.backward()
    for name, column in model.columns().items():
        assert bool(column.values.isfinite().all())
        assert column.values.grad is None or bool(column.values.grad.isfinite().all()), name


@FORMS
@pytest.mark.parametrize("time", [0.1, 0.8])
def test_gradients_are_those_of_finite_differences(form, time):
    model = gaussians(3, form=form, tilt=0.2, duration=1.0).double()
    assert len(model.splats(at(time))) == 3
    check_gradients(model, lambda: drawn(model, at(time)))


# Training.


@FORMS
def test_projection_keeps_rotations_and_bounds(form):
    model = gaussians(form=form)
    with torch.no_grad():
        model.canonical.quats.values.mul_(3.0)
        model.canonical.log_scales.values[0] = 500.0
        model.log_durations.values[0], model.log_durations.values[1] = 500.0, -500.0
    model.project_()
    for side in form.sides(model.canonical.quats.values, model.time_quats.values):
        torch.testing.assert_close(side.norm(dim=1).detach(), torch.ones(20))
    assert float(model.log_durations.values[0].detach()) == pytest.approx(math.log(MAX_DURATION))
    assert bool(model._scales().isfinite().all())


@pytest.mark.parametrize("tilt", [0.0, 0.3, 3.0])
def test_nothing_lives_shorter_than_the_least_and_nothing_else_is_changed(tilt):
    model = gaussians(200, tilt=tilt)
    with torch.no_grad():
        model.canonical.log_scales.values.fill_(math.log(0.01))
        model.log_durations.values[:100] = math.log(1e-4)
    before, scales = model._variances(), model._scales().detach()
    model.project_()
    after = model._variances().sqrt()
    assert float(after.min()) == pytest.approx(MIN_DURATION, rel=1e-4)
    short = before < MIN_DURATION**2
    torch.testing.assert_close(after[short], torch.full_like(after[short], MIN_DURATION))
    torch.testing.assert_close(after[~short], before[~short].sqrt())
    assert bool(((model._scales().detach() != scales).sum(1)[short] == 1).all())
    model.project_()
    torch.testing.assert_close(model._variances().sqrt(), after)


def test_entropy_is_that_of_rows_that_are_seen_and_a_little_of_the_others():
    model = gaussians(60, duration=0.1)
    rows = model.splats(at(0.5)).rows
    assert rows is not None
    visible = torch.arange(len(rows)) % 3 == 0
    found = regularized(model, visible)["entropy"]
    o = model.canonical.opacities()
    seen = torch.zeros(60, dtype=torch.bool)
    seen[rows[visible]] = True
    entropies = -o * o.log()
    expected = entropies[seen].mean() + UNSEEN_SHARE * entropies[~seen].mean()
    torch.testing.assert_close(found, 1e-3 * expected)


def test_velocities_are_compared_with_the_mean_of_the_neighbors():
    model = gaussians(60, duration=0.1)
    rows = model.splats(at(0.5)).rows
    assert rows is not None
    found = regularized(model, torch.ones(len(rows), dtype=torch.bool))["velocity"]
    velocities = []
    for row in range(60):
        whole = space_time(model, row)
        velocities.append(whole[:3, 3] / whole[3, 3])
    points = torch.cat([model.canonical.means.values, 2.0 * model.time_centers.values[:, None]], 1)
    nearest = torch.cdist(points, points).fill_diagonal_(torch.inf).argsort(1)[:, :8]
    differences = [
        (velocities[row] - torch.stack([velocities[n] for n in nearest[row]]).mean(0)).abs().sum()
        for row in rows.tolist()
    ]
    torch.testing.assert_close(found, 0.2 * torch.stack(differences).mean() / 2.0)
    found.backward()
    assert model.time_quats.values.grad is not None
    assert bool(model.time_quats.values.grad.any())


def test_regularizers_are_the_same_if_all_rows_are_sliced(monkeypatch):
    model = gaussians(60, duration=0.1).double()
    rows = model.splats(at(0.5)).rows
    assert rows is not None
    seen = torch.arange(len(rows)) % 3 == 0
    expected = regularized(model, seen)
    monkeypatch.setattr(CpuOperators, "fixed_shapes", True)
    assert model.splats(at(0.5)).rows is None
    everywhere = torch.zeros(60, dtype=torch.bool).index_copy(0, rows, seen)
    found = regularized(model, everywhere)
    assert expected.keys() == found.keys() == {"entropy", "velocity"}
    for name, value in found.items():
        torch.testing.assert_close(value, expected[name])


def test_regularizers_of_weight_zero_are_left_out():
    model = gaussians(regularization=Regularization(0.0, 0.0, 100))
    assert regularized(model, torch.ones(20, dtype=torch.bool)) == {}
    assert len(model.graph.rows) == 0


# What strategies ask for.


def test_sizes_are_the_largest_deviations_of_slices():
    model = gaussians(tilt=1.0).double()
    for row in range(20):
        whole = space_time(model, row)
        sliced = whole[:3, :3] - whole[:3, 3].outer(whole[:3, 3]) / whole[3, 3]
        largest = torch.linalg.eigvalsh(sliced)[-1].sqrt()
        torch.testing.assert_close(model.sizes()[row], largest)


def test_opacities_are_those_of_the_most_visible_moment():
    model = gaussians()
    torch.testing.assert_close(model.opacities(), model.canonical.opacities())
    with torch.no_grad():
        model.time_centers.values[3] = 1e3
    assert float(model.opacities()[3]) == 0.0
    assert float(model.lifetimes()[3]) == 0.0


def test_lifetimes_are_mean_weights_over_the_sequence():
    model = gaussians().double()
    times = torch.linspace(0, 1, 20_001, dtype=torch.float64)[:, None]
    elapsed = times - model.time_centers.values.detach()
    expected = torch.exp(-0.5 * elapsed**2 / model._variances()).mean(0)
    torch.testing.assert_close(model.lifetimes(), expected, rtol=1e-4, atol=1e-5)


def test_children_of_a_split_are_drawn_from_their_gaussian_in_space_and_time():
    model = gaussians(n=3, tilt=1.0, duration=0.1).double()
    with torch.no_grad():
        model.time_centers.values.fill_(0.5)
        model.canonical.log_scales.values.fill_(math.log(0.05))
    rows, copies = torch.tensor([2, 0]), 40_000
    children = model.split_rows(rows, copies, generator())
    means = children["means"].values.view(copies, 2, 3)
    times = children["time_centers"].values.view(copies, 2, 1)
    for position, row in enumerate([2, 0]):
        cloud = torch.cat([means[:, position], times[:, position]], dim=1)
        expected = space_time(model, row)
        center = torch.cat([model.canonical.means.values[row].detach(), torch.tensor([0.5])])
        assert (cloud.mean(0) - center).norm() < 0.03 * expected.diagonal().sqrt().max()
        assert (torch.cov(cloud.T) - expected).norm() < 0.03 * expected.norm()


def test_children_of_what_is_always_there_are_spread_over_the_sequence():
    model = gaussians(n=2, tilt=0.0, duration=MAX_DURATION)
    times = model.split_rows(torch.tensor([1]), 2000, generator())["time_centers"].values
    assert bool(((times >= 0) & (times <= 1)).all())
    assert float(times.std()) == pytest.approx(12**-0.5, abs=0.01)


def test_children_of_a_split_are_smaller_and_otherwise_alike():
    model = gaussians()
    children = model.split_rows(torch.tensor([4, 9, 1]), 2, generator())
    twice = torch.tensor([4, 9, 1, 4, 9, 1])
    for name in ("quats", "time_quats", "opacity_logits", "sh_dc", "sh_rest"):
        assert torch.equal(children[name].values, model.columns()[name].values[twice])
    for name in ("log_scales", "log_durations"):
        shrunk = children[name].values.exp()
        torch.testing.assert_close(shrunk, model.columns()[name].values[twice].exp().detach() / 1.6)
    again = model.split_rows(torch.tensor([4, 9, 1]), 2, generator())
    assert all(torch.equal(children[name].values, again[name].values) for name in children)


def test_relocated_rows_look_as_before_at_their_centre_and_keep_their_path():
    model = gaussians(tilt=1.0)
    rows, counts = torch.tensor([3, 8]), torch.tensor([2, 5])
    velocities = model._sliced(rows).velocities
    changed = model.relocated(rows, counts)
    one = 1 - changed["opacity_logits"].values.sigmoid()
    torch.testing.assert_close(1 - one**counts, model.canonical.opacities()[rows])
    ratios = [
        (changed[name].values - model.columns()[name].values[rows]).exp().detach().view(2, -1)
        for name in ("log_scales", "log_durations")
    ]
    torch.testing.assert_close(ratios[0], ratios[1].expand(2, 3))
    assert bool((ratios[0] < 1).all())
    for name in ("means", "quats", "time_quats", "time_centers", "sh_dc", "sh_rest"):
        assert torch.equal(changed[name].values, model.columns()[name].values[rows])
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    SplatTable(model, optimizer).replace(rows, changed)
    torch.testing.assert_close(model._sliced(rows).velocities, velocities)


def test_noise_has_the_squared_covariance_of_slices_and_spares_opaque_rows():
    model = gaussians(n=1, tilt=1.0)
    many = torch.zeros(30_000, dtype=torch.int64)
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    SplatTable(model, optimizer).append(model.clone_rows(many))
    with torch.no_grad():
        model.canonical.opacity_logits.values[1:] = math.log(0.005 / 0.995)
    before = model.canonical.means.values.detach().clone()
    model.perturb_(2.0, generator(), Operators())
    moved = model.canonical.means.values.detach() - before
    assert float(moved[0].norm()) < 1e-12
    whole = space_time(model, 0)
    sigma = whole[:3, :3] - whole[:3, 3].outer(whole[:3, 3]) / whole[3, 3]
    expected = sigma @ sigma
    assert (torch.cov(moved[1:].T) - expected).norm() < 0.05 * expected.norm()


def test_lowered_opacities_are_capped_and_named():
    model = gaussians()
    assert model.change_opacities_(lambda values: values.clamp_max(0.3)) == ("opacity_logits",)
    assert float(model.canonical.opacities().max()) <= 0.3 + 1e-6


@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_few_rows_and_none_make_splats(n):
    model = gaussians(max(n, 1))
    SplatTable(model, Optimizer(model, Operators(), OptimizerSettings())).keep(torch.arange(n))
    assert len(model.splats(at(0.5))) <= model.num_rows == n
    model.perturb_(1.0, generator(), Operators())
    model.project_()
    assert model.sizes().shape == model.opacities().shape == model.lifetimes().shape == (n,)
