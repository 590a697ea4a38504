"""Edits leave out SH bands, faint splats and motion; everything else stays as it is."""

import math
from dataclasses import replace

import pytest
import torch
from support.moving_splats import at, spacetime
from support.scenes import front_camera, random_splats
from support.view_models import ByView

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.tradeoff.edits import (
    Kept,
    ShTruncation,
    StaticConversion,
    TemporalCulling,
    by_motion,
)
from gsfw.studies.tradeoff.subject import Subject


def of_mixed_degrees(splats):
    """The same splats with degrees 0 to 3 in turn."""
    return replace(splats, colors=splats.colors.of_degrees(torch.arange(len(splats)) % 4))


def in_two_parts(splats):
    """The same splats with their constant coefficients apart, as models keep them."""
    both = splats.colors.coefficients
    return replace(splats, colors=Sh(both[:, :1], 3, rest=both[:, 1:]))


@pytest.mark.parametrize("form", [lambda splats: splats, in_two_parts, of_mixed_degrees])
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_truncation_draws_what_zeroed_coefficients_draw(form, degree):
    splats = form(random_splats(12, degree=3))
    cut = ShTruncation(degree)(splats)
    zeroed = splats.colors.dense().clone()
    zeroed[:, (degree + 1) ** 2 :] = 0
    rasterizer, camera = ReferenceRasterizer(), front_camera()
    expected = rasterizer.render(replace(splats, colors=Sh(zeroed, 3)), camera).color
    torch.testing.assert_close(rasterizer.render(cut, camera).color, expected, atol=1e-6, rtol=0)
    assert cut.sh_degree == degree


def test_truncated_colours_lie_in_memory_of_their_own():
    splats = random_splats(12, degree=3)
    for given in (splats, in_two_parts(splats)):
        cut = ShTruncation(1)(given).colors
        assert all(tensor.is_contiguous() for tensor in cut.tensors().values())
    assert ShTruncation(3)(splats) is splats


def test_what_is_fainter_than_any_pixel_shows_changes_no_bit():
    splats = random_splats(30)
    splats = replace(splats, opacities=torch.logspace(-4, 0, 30))
    culled = TemporalCulling(DEFAULT.alpha_min)(splats)
    assert 0 < len(culled) < 30
    rasterizer, camera = ReferenceRasterizer(), front_camera()
    assert torch.equal(
        rasterizer.render(culled, camera).color, rasterizer.render(splats, camera).color
    )


def test_splats_are_culled_by_their_opacity_at_the_time_and_stay_those_of_their_rows():
    model = spacetime()
    subject = Subject(model, ReferenceRasterizer(), RenderSettings(), False, dtype=torch.float64)
    culled = replace(subject, edits=(TemporalCulling(0.1),))
    rows_by_time = []
    for time in (at(0.1), at(0.9)):
        before, after = subject.splats(time), culled.splats(time)
        assert torch.equal(after.rows, before.rows[before.opacities >= 0.1])
        assert torch.equal(after.means, before.means[before.opacities >= 0.1])
        rows_by_time.append(set(after.rows.tolist()))
    assert rows_by_time[0] != rows_by_time[1]


def test_as_much_is_stored_as_before():
    subject = Subject(spacetime(), ReferenceRasterizer(), RenderSettings(), is_still=False)
    culled = replace(subject, edits=(TemporalCulling(0.9),))
    assert len(culled.splats()) < len(subject.splats())
    assert culled.num_floats() == subject.num_floats()
    assert culled.num_gaussians() == 20


TIMES = [at(time) for time in (0.0, 0.3, 0.5, 1.0)]
ROWS = torch.tensor([1, 2, 5, 11])


def subject_of(model):
    return Subject(model, ReferenceRasterizer(), RenderSettings(), False, dtype=torch.float64)


def converted(subject, rows):
    return replace(subject, edits=(StaticConversion.of(subject, rows),))


def image(subject, time):
    return subject.render(subject.splats(time), front_camera(dtype=torch.float64)).color


def test_no_row_is_the_model_as_it_is():
    subject = subject_of(spacetime())
    none = converted(subject, torch.arange(0))
    for time in TIMES:
        assert torch.equal(image(none, time), image(subject, time))
    assert none.num_floats() == subject.num_floats()


@pytest.mark.parametrize("settings", [{}, {"colors": "features"}, {"motion": "adaptive"}])
def test_all_rows_are_the_model_in_the_middle_at_every_time(settings):
    subject = subject_of(spacetime(**settings))
    still = converted(subject, torch.arange(20))
    for time in TIMES:
        assert torch.equal(image(still, time), image(subject, at(0.5)))
    assert not torch.equal(image(subject, at(0.0)), image(subject, at(0.5)))


def by_row(splats):
    """Positions of what is drawn, by row."""
    rows = range(len(splats)) if splats.rows is None else splats.rows.tolist()
    return dict(zip(rows, splats.means.tolist(), strict=True))


def test_some_rows_are_as_in_the_middle_and_all_others_as_they_are():
    subject = subject_of(spacetime())
    some, middle = converted(subject, ROWS), by_row(subject.splats(at(0.5)))
    held = {row: middle[row] for row in ROWS.tolist()}
    for time in TIMES:
        now = by_row(subject.splats(time))
        found = by_row(some.splats(time))
        assert found == {row: now[row] for row in now if row not in held} | held
        assert list(found) == sorted(found)


def test_what_is_not_there_in_the_middle_is_never_drawn():
    model = spacetime()
    with torch.no_grad():
        model.columns()["time_centers"].values[3] = 0.0
        model.columns()["log_durations"].values[3] = math.log(0.05)
        model.columns()["opacity_logits"].values[3] = 3.0
    subject = subject_of(model)
    still = converted(subject, torch.tensor([3]))
    assert 3 in by_row(subject.splats(at(0.0)))
    assert all(3 not in by_row(still.splats(time)) for time in TIMES)


def colors_in_two_parts(colors):
    return Sh(colors.coefficients[:, :1], 2, rest=colors.coefficients[:, 1:])


def colors_of_mixed_degrees(colors):
    return colors.of_degrees(torch.arange(12) % 3)


@pytest.mark.parametrize(
    "form",
    [
        lambda colors: colors,
        colors_in_two_parts,
        colors_of_mixed_degrees,
        lambda _: torch.rand(12, 4),
    ],
)
def test_every_form_of_colours_stays_with_its_row(form):
    now = random_splats(12, degree=2)
    now = replace(now, colors=form(now.colors))
    held = replace(now, means=now.means + 1, rows=torch.arange(12)).take(ROWS)
    found = StaticConversion(ROWS, lambda camera: held)(now)
    is_still = torch.isin(torch.arange(12), ROWS)
    assert torch.equal(found.means, now.means + is_still[:, None])
    colors, expected = found.colors, now.colors
    if isinstance(expected, Sh):
        colors, expected = colors.dense(), expected.dense()
    assert torch.equal(colors, expected)


def at_rest(count):
    """Gaussians that are always there and do not move."""
    model = spacetime(count)
    columns = model.columns()
    with torch.no_grad():
        columns["opacity_logits"].values.fill_(2.0)
        columns["time_centers"].values.fill_(0.5)
        columns["log_durations"].values.fill_(math.log(10.0))
        columns["motion"].values.zero_()
    return model


def test_rows_come_in_the_order_of_how_far_they_go_and_those_that_come_and_go_last():
    model = at_rest(4)
    columns = model.columns()
    with torch.no_grad():
        columns["log_durations"].values[1] = math.log(0.2)
        columns["motion"].values[:, 0, 0] = torch.tensor([0.3, 0.0, -0.1, 0.2])
    assert by_motion(subject_of(model), [front_camera()]).tolist() == [2, 3, 0, 1]
    with torch.no_grad():  # This one is gone for longer.
        columns["log_durations"].values[0] = math.log(0.05)
    assert by_motion(subject_of(model), [front_camera()]).tolist() == [2, 3, 1, 0]


def test_kept_rows_are_the_same_in_every_form_of_colours():
    splats = random_splats(6, degree=2)
    rows = torch.tensor([0, 2, 5])
    dense = Kept(rows)(splats)
    both = splats.colors.coefficients
    apart = Kept(rows)(replace(splats, colors=Sh(both[:, :1], 2, rest=both[:, 1:])))
    mixed = replace(splats, colors=splats.colors.of_degrees(torch.tensor([2, 1, 2, 0, 0, 2])))
    for kept in (dense, apart, Kept(rows)(mixed)):
        assert torch.equal(kept.means, splats.means[rows])
        assert torch.equal(kept.opacities, splats.opacities[rows])
        assert torch.equal(kept.colors.dense(), splats.colors.dense()[rows])


class Parallax(ByView):
    """Another model, whose row 0 moves for cameras alone, by as much as the camera is wide."""

    def splats(self, time=None, cameras=None):
        splats = self.given.splats(time, cameras)
        if cameras is None:
            return splats
        means = splats.means.clone()
        means[0, 0] += cameras.width * time
        return replace(splats, means=means)


def test_motion_and_static_rows_are_those_that_a_camera_sees():
    model = at_rest(4)
    with torch.no_grad():
        model.columns()["motion"].values[1, 0, 0] = 0.1
    camera = front_camera(dtype=torch.float64)
    subject = subject_of(Parallax(model))
    assert by_motion(subject_of(model), [camera]).tolist() == [0, 2, 3, 1]
    assert by_motion(subject, [camera.resized(1, 1), camera]).tolist() == [2, 3, 1, 0]
    still = converted(subject, torch.arange(4))
    middle, wide = subject.splats(at(0.5), camera), camera.resized(2 * camera.width, camera.height)
    assert torch.equal(still.splats(at(1.0), camera).means, middle.means)
    assert torch.equal(still.splats(at(1.0), wide).means, subject.splats(at(0.5), wide).means)
    assert not torch.equal(still.splats(at(1.0), wide).means, middle.means)


def test_smaller_renders_have_the_splats_of_smaller_cameras():
    camera = front_camera(32, 24, dtype=torch.float64)
    subject = subject_of(Parallax(at_rest(4)))
    halved = replace(subject, shrink=2)
    expected = subject.splats(at(1.0), camera.resized(16, 12))
    assert torch.equal(halved.splats(at(1.0), camera).means, expected.means)
