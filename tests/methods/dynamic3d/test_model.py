"""Tracked Gaussians: advancing, drawing any time, rows, gradients, and what strategies ask for."""

import math

import pytest
import torch
from support.gaussians import no_contributions, no_views
from support.model_gradients import check_gradients, drawn
from support.moving_splats import at, seeded
from support.scenes import front_camera
from support.tracked_splats import after, move_, tracked

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.splats import Sh, Splats
from gsfw.core.table import SplatTable
from gsfw.methods.dynamic3d.model import TrackedGaussians


def context(model: TrackedGaussians, step: int = 0, extent: float = 2.0) -> StepContext:
    image = torch.zeros(1, 30, 40, 3, dtype=torch.float64)
    splats = model.splats()
    statistics = RenderStatistics.zeros(splats.means.detach(), 1, frozenset())
    return StepContext(
        step=step, steps=10, batch=Batch(image, front_camera(), (0,)),
        splats=splats, rendered=RenderOutput(image, image[..., :1], statistics),
        target=image, num_rows=model.num_rows, share=1.0, extent=extent,
        operators=Operators(), render=no_views, contributions=no_contributions,
    )  # fmt: skip


def table_of(model: TrackedGaussians) -> SplatTable:
    return SplatTable(model, Optimizer(model, Operators(), OptimizerSettings()))


def same(first: Splats, second: Splats) -> bool:
    return all(torch.equal(a, second.tensors()[name]) for name, a in first.tensors().items())


# Time.


def test_at_the_first_time_it_is_a_static_model():
    model = tracked()
    model.advance_(0.0)
    for time in (None, at(0.0), at(0.7)):
        assert same(model.splats(time), model.canonical.splats())
    assert not model.tracking
    assert model.regularizers(context(model)) == {}
    assert model.summary()["stored_bytes"] == 0


def test_a_new_time_begins_where_the_last_one_ended():
    model = tracked()
    model.advance_(0.0)
    before = {name: value.clone() for name, value in model.splats().tensors().items()}
    model.advance_(0.5)
    assert model.tracking
    now = model.splats(at(0.5)).tensors()
    assert torch.equal(now["means"].float(), before["means"].float())
    for name in ("scales", "opacities", "colors", "rest"):
        assert torch.equal(now[name], before[name]), name


def test_what_moves_is_expected_to_move_on():
    model = tracked()
    model.advance_(0.0)
    model.advance_(0.5)
    first = model.canonical.means.values.detach().clone()
    move_(model, (0.1, -0.2, 0.3))
    model.advance_(0.6)
    expected = first + 2 * torch.tensor([0.1, -0.2, 0.3], dtype=torch.float64)
    torch.testing.assert_close(model.canonical.means.values.detach(), expected, atol=1e-6, rtol=0)
    norms = model.canonical.quats.values.norm(dim=1)
    torch.testing.assert_close(norms, torch.ones_like(norms))


def test_a_body_that_turns_is_expected_to_stay_on_its_circle():
    """By a sixth of a turn around z each time; half of that angle is in the quaternion."""
    model, angle = tracked(), math.pi / 3
    means, quats = model.canonical.means.values, model.canonical.quats.values

    def turned(points: torch.Tensor, times: int) -> torch.Tensor:
        cos, sin = math.cos(times * angle), math.sin(times * angle)
        return points @ torch.tensor([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]).to(points)

    first = means.detach().clone()
    with torch.no_grad():
        quats.copy_(torch.tensor([1.0, 0.0, 0.0, 0.0]))
        model.advance_(0.0)
        model.advance_(0.5)
        means.copy_(turned(first, 1))
        quats.copy_(torch.tensor([math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]))
    model.advance_(0.6)
    torch.testing.assert_close(means.detach(), turned(first, 2), atol=1e-3, rtol=0)


@pytest.mark.parametrize("time", [-1e8, -10.0, 1.0, 10.0, 1e8])
def test_times_outside_of_the_sequence_are_those_of_its_ends(time):
    model = tracked()
    model.advance_(0.0)
    move_(model, (0.1, 0.0, 0.0))
    model.advance_(0.25)
    move_(model, (0.0, 1e3, 0.0))
    end = 0.0 if time < 0 else 0.25
    assert same(model.splats(at(time)), model.splats(at(end)))


def test_places_far_away_turns_by_half_and_quaternions_of_nothing_stay_finite_between_times():
    model = tracked()
    model.advance_(0.0)
    quats, means = model.canonical.quats.values, model.canonical.means.values
    with torch.no_grad():
        quats.copy_(torch.tensor([1.0, 0.0, 0.0, 0.0]))
        model.advance_(1e-9)
        means.fill_(1e30)
        quats.copy_(torch.tensor([0.0, 1.0, 0.0, 0.0]))
        quats[0] = 0.0
    for time in (0.0, 5e-10, 1e-9, 1.0):
        splats = model.splats(at(time))
        assert all(bool(values.isfinite().all()) for values in splats.tensors().values())
    gradient = torch.autograd.grad(splats.means.sum() + splats.quats.sum(), [means, quats])
    assert all(bool(values.isfinite().all()) for values in gradient)


def test_every_time_is_drawn_as_it_was_left():
    model, left = tracked(), {}
    for index, time in enumerate((0.0, 0.3, 1.0)):
        model.advance_(time)
        move_(model, noise=0.1, seed=index)
        left[time] = model.splats(at(time)).map(lambda values: values.detach().clone())
    for time, expected in left.items():
        found = model.splats(at(time))
        torch.testing.assert_close(found.means, expected.means, atol=1e-6, rtol=0)
        assert isinstance(found.colors, Sh)
        assert isinstance(expected.colors, Sh)
        torch.testing.assert_close(
            found.colors.coefficients, expected.colors.coefficients, atol=2e-3, rtol=1e-3
        )
    assert same(model.splats(), model.splats(at(0.0))), "no time is the beginning"
    assert same(model.splats(at(1.0)), model.splats(at(5.0))), "what is to come looks as now"
    middle = model.splats(at(0.65)).means
    torch.testing.assert_close(middle, (left[0.3].means + left[1.0].means) / 2, atol=1e-6, rtol=0)


def test_fixed_colours_are_those_of_the_first_time():
    model = after((0.0, 0.5, 1.0), colors="fixed")
    assert "past_colors" not in model.columns()
    for time in (0.0, 0.5, 1.0):
        colors = model.splats(at(time)).colors
        assert isinstance(colors, Sh)
        assert colors.coefficients is model.canonical.sh_dc.values


# Gradients.


@pytest.mark.parametrize("time", [0.5, 0.8, 1.0])
def test_gradients_agree_with_difference_quotients_for_every_column(time):
    model = after((0.0, 0.5, 1.0), n=4)
    check_gradients(model, lambda: drawn(model, at(time)))
    sum(tensor.sum() for tensor in drawn(model, at(time))).backward()
    found = model.columns()["means"].values.grad
    assert (found is not None and bool(found.any())) == (time > 0.5)


def test_gradients_of_the_regularisers_agree_with_difference_quotients():
    model = after((0.0, 0.5, 1.0), n=6)
    given = context(model)
    check_gradients(model, lambda: [*model.regularizers(given).values()])


def test_terms_have_their_weights_and_no_units():
    def terms_of(model: TrackedGaussians, extent: float = 2.0) -> dict[str, float]:
        terms = model.regularizers(context(model, extent=extent))
        return {name: float(term.detach()) for name, term in terms.items()}

    model = after((0.0, 0.5, 1.0), rigid=4.0, rotation=4.0)
    terms = terms_of(model)
    assert set(terms) == {"rigid", "rotation", "isometry", "color_change"}
    heavier = after((0.0, 0.5, 1.0), rigid=8.0, rotation=4.0, isometry=0.0, color_change=0.02)
    found = terms_of(heavier)
    factors = {"rigid": 2.0, "rotation": 1.0, "isometry": 0.0, "color_change": 2.0}
    for name, factor in factors.items():
        assert found[name] == pytest.approx(factor * terms[name]), name
    assert terms_of(model, extent=4.0)["rigid"] == pytest.approx(terms["rigid"] / 2)


# Rows.


def test_rows_keep_their_past_when_others_go():
    model = after((0.0, 0.5, 1.0))
    before = model.splats(at(0.2))
    kept = torch.tensor([3, 7, 19])
    table_of(model).keep(kept)
    assert same(model.splats(at(0.2)), before.map(lambda values: values[kept]))


def test_children_have_the_past_of_their_parents():
    model = after((0.0, 0.5, 1.0))
    table, rows = table_of(model), torch.tensor([2, 5])
    past = model.splats(at(0.0)).means[rows]
    table.append(model.clone_rows(rows))
    table.append(model.split_rows(rows, 2, seeded()))
    table.append(model.relocated(rows, torch.tensor([2, 3])))
    assert torch.equal(model.splats(at(0.0)).means[20:], past.repeat(4, 1))
    assert not torch.equal(model.splats(at(1.0)).means[22:24], model.splats(at(1.0)).means[rows])


def test_rows_that_are_tried_have_stood_still():
    model = after((0.0, 0.5, 1.0))
    points = torch.tensor([[0.5, 0.25, 0.125]])
    children = model.rows_at(points, torch.full((1, 3), 0.5), torch.tensor([0.1]), 1.0)
    table_of(model).append(children)
    for time in (0.0, 0.3, 1.0):
        assert torch.equal(model.splats(at(time)).means[-1:].float(), points)


def test_a_graph_of_other_rows_is_made_anew():
    model = after((0.0, 0.5, 1.0))
    model.regularizers(context(model))
    table_of(model).keep(torch.arange(12))
    terms = model.regularizers(context(model))
    assert all(bool(term.isfinite()) for term in terms.values())


def test_noise_moves_rows_at_the_first_time_only():
    model = tracked()
    with torch.no_grad():
        model.canonical.opacity_logits.values.fill_(-8.0)
    for time, moves in ((0.0, True), (1.0, False)):
        model.advance_(time)
        before = model.canonical.means.values.detach().clone()
        model.perturb_(1.0, seeded(), Operators())
        assert torch.equal(model.canonical.means.values, before) != moves


def test_what_is_stored_counts_as_part_of_the_model():
    model = after((0.0, 0.5, 1.0))
    summary, still = model.summary(), model.canonical.summary()
    assert summary["stored_bytes"] == model.trajectory.num_bytes() > 0
    assert summary["model_bytes"] == summary["stored_bytes"] + still["model_bytes"]
    assert model.opacities().shape == model.sizes().shape == (20,)
    assert model.active_bands() == model.canonical.active_bands()
    assert model.change_opacities_(lambda values: values.clamp_max(0.3)) == ("opacity_logits",)
    assert float(model.opacities().max()) < 0.3 + 1e-9
