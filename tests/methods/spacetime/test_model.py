"""Spacetime Gaussians: the equations in float64, gradients, rows, and what strategies ask for."""

import math
from dataclasses import replace

import pytest
import torch
from support.gaussians import no_contributions, no_views
from support.model_gradients import check_gradients, drawn
from support.moving_splats import at, moving_scene, seeded, spacetime
from support.scenes import front_camera, random_splats

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.numerics import DEFAULT
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.core.table import SplatTable
from gsfw.methods.spacetime.model import MAX_DURATION, SpacetimeGaussians
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

TIMES = (0.0, 0.31, 1.0)


def shown(splats: Splats) -> list[int]:
    """The model row of each splat."""
    return list(range(len(splats))) if splats.rows is None else splats.rows.tolist()


@pytest.mark.parametrize("time", [*TIMES, -0.5, 2.0])
@pytest.mark.parametrize("order", [1, 3])
def test_splats_follow_the_equations_of_the_paper(time, order):
    model = spacetime(motion_order=order)
    splats = model.splats(at(time))
    assert splats.quats is not None
    column = {name: found.values.detach() for name, found in model.columns().items()}
    for splat, row in enumerate(shown(splats)):
        elapsed = time - float(column["time_centers"][row])
        deviation = math.exp(float(column["log_durations"][row]))
        opacity = 1 / (1 + math.exp(-float(column["opacity_logits"][row])))
        weight = math.exp(-(elapsed**2) / (2 * deviation**2))
        assert splats.opacities[splat].item() == pytest.approx(opacity * weight, rel=1e-12)
        mean = column["means"][row].clone()
        for power in range(order):
            mean += column["motion"][row, power] * elapsed ** (power + 1)
        torch.testing.assert_close(splats.means[splat].detach(), mean)
        quat = column["quats"][row] + column["spins"][row] * elapsed
        torch.testing.assert_close(splats.quats[splat].detach(), quat)


def test_shape_and_colour_do_not_change_with_time():
    model = spacetime()
    splats, still = model.splats(at(0.4)), model.canonical.splats()
    rows = shown(splats)
    assert splats.scales is not None
    assert still.scales is not None
    assert isinstance(splats.colors, Sh)
    assert isinstance(still.colors, Sh)
    torch.testing.assert_close(splats.scales, still.scales[rows])
    torch.testing.assert_close(splats.colors.dense(), still.colors.dense()[rows])


def test_features_are_two_threes_and_one_of_them_grows_with_time():
    model = spacetime(colors="features")
    assert model.canonical.degree == 0
    splats = model.splats(at(0.7))
    assert splats.extra is not None
    rows = shown(splats)
    column = model.columns()
    elapsed = (0.7 - column["time_centers"].values[rows]).detach()
    torch.testing.assert_close(splats.extra[:, :3], column["features"].values[rows])
    rates = column["feature_rates"].values[rows]
    torch.testing.assert_close(splats.extra[:, 3:], rates * elapsed[:, None])


def test_no_time_is_the_beginning():
    model = spacetime()
    torch.testing.assert_close(model.splats().means, model.splats(at(0.0)).means)


# Gradients.


def weighted_sum(splats: Splats) -> torch.Tensor:
    """A number that depends on every value that is drawn."""
    total = torch.zeros((), dtype=torch.float64)
    for index, tensor in enumerate(splats.tensors().values()):
        weights = torch.randn(tensor.shape, generator=seeded(index), dtype=torch.float64)
        total = total + (weights * tensor).sum()
    return total


@pytest.mark.parametrize("colors", ["sh", "features"])
def test_gradients_agree_with_difference_quotients_for_every_parameter(colors):
    model = spacetime(n=4, colors=colors, init_duration=0.5)
    assert model.splats(at(0.6)).rows is None, "a row on the edge of sight has no derivative"
    # The gradient of the centre is stopped wherever it is not that of the opacity.
    check_gradients(model, lambda: drawn(model, at(0.6)), without=("time_centers",))
    check_gradients(model, lambda: [model.splats(at(0.6)).opacities])


def test_the_temporal_centre_is_moved_by_the_opacity_alone():
    model = spacetime(n=4)
    splats = model.splats(at(0.6))
    assert splats.quats is not None
    (splats.means.sum() + splats.quats.sum()).backward()
    assert model.columns()["time_centers"].values.grad is None
    assert model.columns()["motion"].values.grad is not None


def test_a_gradient_reaches_the_time_through_means_and_opacities():
    model = spacetime(n=4)
    time = at(0.6).requires_grad_()
    model.splats(time).means.sum().backward()
    assert time.grad is not None
    assert float(time.grad) != 0


# Rows.


def test_exactly_the_rows_that_no_pixel_can_show_are_left_out():
    model = spacetime(n=60)
    column = model.columns()
    durations = column["log_durations"].values.detach().exp()
    elapsed = 0.1 - column["time_centers"].values.detach()
    seen = model.opacities() * torch.exp(-0.5 * (elapsed / durations) ** 2) >= DEFAULT.alpha_min
    splats = model.splats(at(0.1))
    assert 0 < len(splats) < 60
    assert shown(splats) == seen.nonzero()[:, 0].tolist()


def test_leaving_rows_out_changes_neither_image_nor_gradients(monkeypatch):
    def drawn(model):
        model.zero_grad()
        output = ReferenceRasterizer().render(
            model.splats(at(0.1)), front_camera(dtype=torch.float64), RenderSettings()
        )
        output.color.square().sum().backward()
        gradients = [column.values.grad.clone() for column in model.columns().values()]
        return output.color.detach(), gradients

    model = spacetime(n=60)
    image, gradients = drawn(model)
    monkeypatch.setattr(SpacetimeGaussians, "_visible", lambda self, opacities: None)
    assert len(model.splats(at(0.1))) == 60
    whole, of_all = drawn(model)
    assert torch.equal(image, whole)
    for found, expected in zip(gradients, of_all, strict=True):
        torch.testing.assert_close(found, expected)


def test_a_time_at_which_nothing_is_there_has_no_splats():
    model = spacetime(n=5)
    splats = model.splats(at(100.0))
    assert len(splats) == 0
    assert shown(splats) == []
    weighted_sum(splats).backward()


def test_one_row_and_no_row_make_splats():
    for n in (0, 1):
        model = spacetime()
        table = SplatTable(model, Optimizer(model, Operators(), OptimizerSettings()))
        table.keep(torch.arange(n))
        assert len(model.splats(at(0.5))) <= model.num_rows == n
        model.perturb_(1.0, seeded(), Operators())
        model.project_()
        assert model.lifetimes().shape == model.sizes().shape == (n,)
        assert len(model.split_rows(torch.arange(n), 2, seeded())["motion"].values) == 2 * n


# What strategies ask for.


def test_lifetimes_are_the_mean_weight_over_the_sequence():
    model = spacetime(n=8)
    column = model.columns()
    with torch.no_grad():
        column["log_durations"].values[:2] = torch.tensor([0.025, 10.0]).log()
    times = (torch.arange(20_000, dtype=torch.float64) + 0.5) / 20_000
    elapsed = times[:, None] - column["time_centers"].values.detach()
    weights = torch.exp(-0.5 * (elapsed / column["log_durations"].values.detach().exp()) ** 2)
    torch.testing.assert_close(model.lifetimes(), weights.mean(0), rtol=1e-6, atol=1e-6)
    assert float(model.lifetimes()[1]) > 0.99


def positions(children, time: float) -> torch.Tensor:
    elapsed = (time - children["time_centers"].values)[:, None]
    motion = children["motion"].values
    powers = [motion[:, power] * elapsed ** (power + 1) for power in range(motion.shape[1])]
    return children["means"].values + sum(powers)


def test_clones_are_at_times_of_their_own_on_the_same_paths():
    model, rows = spacetime(), torch.tensor([3, 8, 3])
    same, apart = model.clone_rows(rows), model.clone_rows(rows, seeded())
    assert set(same) == set(apart) == set(model.columns())
    for name, column in model.columns().items():
        assert torch.equal(same[name].values, column.values.detach()[rows]), name
    centers = apart["time_centers"].values
    assert not torch.isclose(centers, same["time_centers"].values).any()
    assert bool(((centers >= 0) & (centers <= 1)).all())
    assert centers[0] != centers[2]
    for time in TIMES:
        torch.testing.assert_close(positions(apart, time), positions(same, time))
        turned = [
            children["quats"].values
            + children["spins"].values * (time - children["time_centers"].values)[:, None]
            for children in (apart, same)
        ]
        torch.testing.assert_close(*turned)


def test_children_of_a_split_go_along_with_their_parent():
    model, rows = spacetime(), torch.tensor([4, 9])
    children = model.split_rows(rows, 2, seeded())
    parents = model.clone_rows(rows.repeat(2))
    offsets = [positions(children, time) - positions(parents, time) for time in TIMES]
    assert bool(offsets[0].any())
    torch.testing.assert_close(offsets[0], offsets[1])
    torch.testing.assert_close(offsets[0], offsets[2])
    smaller = parents["log_scales"].values - math.log(1.6)
    torch.testing.assert_close(children["log_scales"].values, smaller)
    assert torch.equal(children["log_durations"].values, parents["log_durations"].values)


def test_new_temporal_centres_are_drawn_where_the_parent_is_seen():
    model = spacetime(n=3)
    column = model.columns()
    with torch.no_grad():
        column["time_centers"].values.copy_(torch.tensor([0.5, 0.2, 0.9]))
        column["log_durations"].values.copy_(torch.tensor([0.05, MAX_DURATION, 0.2]).log())
    drawn = model.clone_rows(torch.arange(3).repeat(20_000), seeded())["time_centers"].values
    brief, lasting, late = drawn.view(-1, 3).unbind(1)
    assert float(brief.mean()) == pytest.approx(0.5, abs=2e-3)
    assert float(brief.std()) == pytest.approx(0.05, rel=0.02)
    assert float(lasting.mean()) == pytest.approx(0.5, abs=0.01), "uniform"
    assert float(lasting.std()) == pytest.approx(12**-0.5, rel=0.02)
    # The mean of a normal deviate that is cut off at half of its deviation above the centre.
    above = math.exp(-0.5 * 0.5**2) / math.sqrt(2 * math.pi)
    share = 0.5 * (1 + math.erf(0.5 / math.sqrt(2)))
    assert float(late.mean()) == pytest.approx(0.9 - 0.2 * above / share, abs=4e-3)
    assert float(drawn.min()) >= 0
    assert float(drawn.max()) <= 1


def test_relocated_rows_look_as_before_and_keep_their_paths():
    model, rows = spacetime(), torch.tensor([3, 8])
    counts = torch.tensor([2, 5])
    changed = model.relocated(rows, counts)
    one = 1 - changed["opacity_logits"].values.sigmoid()
    torch.testing.assert_close(1 - one**counts, model.opacities()[rows])
    for name in ("means", "quats", "time_centers", "log_durations", "motion", "spins"):
        assert torch.equal(changed[name].values, model.columns()[name].values[rows])


def test_what_does_not_concern_time_is_that_of_static_gaussians():
    model = spacetime()
    assert torch.equal(model.sizes(), model.canonical.sizes())
    before = model.opacities()
    assert model.change_opacities_(lambda values: values.clamp_max(0.3)) == ("opacity_logits",)
    torch.testing.assert_close(model.opacities(), before.clamp_max(0.3))
    model.canonical.active_degree = 0
    assert model.active_bands() == 0
    centers = model.columns()["means"].values.clone()
    model.perturb_(1e9, seeded(), Operators())
    assert not torch.equal(model.columns()["means"].values, centers)


def test_the_same_seed_gives_the_same_children():
    model, rows = spacetime(), torch.arange(10)
    first, again, other = (model.split_rows(rows, 2, seeded(seed)) for seed in (3, 3, 4))
    for name in ("means", "time_centers", "motion"):
        assert torch.equal(first[name].values, again[name].values)
        assert not torch.equal(first[name].values, other[name].values)


def test_projection_keeps_durations_and_centres_in_bounds():
    model = spacetime(n=4)
    column = model.columns()
    with torch.no_grad():
        column["log_durations"].values[:2] = torch.tensor([-50.0, 50.0])
        column["time_centers"].values[:2] = torch.tensor([-3.0, 7.0])
        column["log_scales"].values[0] = 500.0
    model.project_()
    quarter_of_a_frame = 0.25 / (moving_scene().num_times - 1)
    durations = column["log_durations"].values.detach().exp()
    assert durations[:2].tolist() == pytest.approx([quarter_of_a_frame, 10.0])
    assert column["time_centers"].values[:2].tolist() == [0.0, 1.0]
    assert bool(model.sizes().isfinite().all())


def test_the_lifetime_term_is_the_mean_opacity_at_that_time_without_gradient_to_time():
    model = spacetime(lifetime_reg=0.01)
    camera = replace(front_camera(dtype=torch.float64), time=torch.tensor([0.2]).double())
    images = torch.zeros(1, 30, 40, 3)
    statistics = RenderStatistics(torch.ones(1, 20, dtype=torch.bool), torch.ones(1, 20))
    context = StepContext(
        step=0, steps=10, batch=Batch(images, camera, (0,)),
        splats=random_splats(20), rendered=RenderOutput(images, images[..., :1], statistics),
        target=images, num_rows=20, share=1.0, extent=1.0, operators=Operators(),
        render=no_views,
        contributions=no_contributions,
    )  # fmt: skip
    (term,) = model.regularizers(context).values()
    column = model.columns()
    elapsed = 0.2 - column["time_centers"].values.detach()
    weights = torch.exp(-0.5 * (elapsed / column["log_durations"].values.detach().exp()) ** 2)
    torch.testing.assert_close(
        term.detach(), 0.01 * (model.opacities() * weights).mean(), rtol=1e-6, atol=0.0
    )
    term.backward()
    assert column["opacity_logits"].values.grad is not None
    assert column["time_centers"].values.grad is None
    assert column["log_durations"].values.grad is None
    assert spacetime().regularizers(context) == {}


# Extremes of time: section 12 of the catalogue.


@pytest.mark.parametrize("time", [-10.0, -1e-6, 0.5, 1.0 + 1e-6, 10.0])
@pytest.mark.parametrize("duration", [1e-8, 1e8, None])
@pytest.mark.parametrize("colors", ["sh", "features"])
def test_extremes_of_time_are_finite_in_float32(time, duration, colors):
    model = spacetime(n=30, colors=colors, motion_order=5, lifetime_reg=0.01).float()
    column = model.columns()
    with torch.no_grad():
        column["time_centers"].values[0] = time
        column["motion"].values.mul_(1000.0)
        if duration is not None:
            column["log_durations"].values.fill_(math.log(duration))
    splats = model.splats(torch.tensor(time))
    assert len(splats) > 0
    for name, tensor in splats.tensors().items():
        assert bool(tensor.isfinite().all()), name
        tensor.sum().backward(retain_graph=True)
    for name, found in column.items():
        gradient = found.values.grad
        assert gradient is None or bool(gradient.isfinite().all()), name
    assert bool(model.lifetimes().isfinite().all())
    for children in (model.clone_rows(torch.arange(30), seeded()),):
        for name, rows in children.items():
            assert bool(rows.values.isfinite().all()), name


def test_random_draws_of_every_extreme_are_finite_and_so_are_their_covariances():
    n, generator = 10_000, seeded()
    model = spacetime(n=n, degree=0, motion_order=5).float()

    def spread(shape, low, high):
        return 10 ** (low + (high - low) * torch.rand(shape, generator=generator))

    column = model.columns()
    with torch.no_grad():
        column["log_durations"].values.copy_(spread((n,), -8, 8).log())
        column["time_centers"].values.copy_(2 * torch.rand(n, generator=generator) - 0.5)
        column["motion"].values.mul_(spread((n, 1, 1), -8, 4))
        column["spins"].values.mul_(spread((n, 1), -8, 8))
        column["log_scales"].values.copy_(spread((n, 3), -10, 6).log())
    model.project_()
    for time in (-10.0, 0.0, 0.5, 10.0):
        splats = model.splats(torch.tensor(time))
        assert splats.scales is not None
        assert bool((splats.scales > 0).all()), "scales and quaternions are PSD by construction"
        assert all(bool(tensor.isfinite().all()) for tensor in splats.tensors().values())
