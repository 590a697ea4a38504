"""Rows that become still look as they do in the middle, and those that move least come first."""

import math
from dataclasses import replace

import pytest
import torch
from support.moving_splats import at, spacetime
from support.scenes import front_camera, random_splats

from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.tradeoff.edits import StaticConversion, by_motion
from gsfw.studies.tradeoff.subject import Subject

TIMES = [at(time) for time in (0.0, 0.3, 0.5, 1.0)]
ROWS = torch.tensor([1, 2, 5, 11])


def subject_of(model):
    return Subject(model, ReferenceRasterizer(), RenderSettings(), False, dtype=torch.float64)


def converted(subject, rows):
    return replace(subject, edits=(StaticConversion.of(subject, rows),))


def picture(subject, time):
    return subject.render(subject.splats(time), front_camera(dtype=torch.float64)).color


def test_no_row_is_the_model_as_it_is():
    subject = subject_of(spacetime())
    none = converted(subject, torch.arange(0))
    for time in TIMES:
        assert torch.equal(picture(none, time), picture(subject, time))
    assert none.num_floats() == subject.num_floats()


@pytest.mark.parametrize("settings", [{}, {"colors": "features"}, {"motion": "adaptive"}])
def test_all_rows_are_the_model_in_the_middle_at_every_time(settings):
    subject = subject_of(spacetime(**settings))
    still = converted(subject, torch.arange(20))
    for time in TIMES:
        assert torch.equal(picture(still, time), picture(subject, at(0.5)))
    assert not torch.equal(picture(subject, at(0.0)), picture(subject, at(0.5)))


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


def in_two_parts(colors):
    return Sh(colors.coefficients[:, :1], 2, rest=colors.coefficients[:, 1:])


def of_mixed_degrees(colors):
    return colors.of_degrees(torch.arange(12) % 3)


@pytest.mark.parametrize(
    "form", [lambda colors: colors, in_two_parts, of_mixed_degrees, lambda _: torch.rand(12, 4)]
)
def test_every_form_of_colours_stays_with_its_row(form):
    now = random_splats(12, degree=2)
    now = replace(now, colors=form(now.colors))
    held = replace(now, means=now.means + 1, rows=torch.arange(12)).take(ROWS)
    found = StaticConversion(ROWS, held)(now)
    is_still = torch.isin(torch.arange(12), ROWS)
    assert torch.equal(found.means, now.means + is_still[:, None])
    colors, expected = found.colors, now.colors
    if isinstance(expected, Sh):
        colors, expected = colors.dense(), expected.dense()
    assert torch.equal(colors, expected)


def test_rows_come_in_the_order_of_how_far_they_go_and_those_that_come_and_go_last():
    model = spacetime(4)
    columns = model.columns()
    with torch.no_grad():
        columns["opacity_logits"].values.fill_(2.0)
        columns["time_centers"].values.fill_(0.5)
        columns["log_durations"].values.fill_(math.log(10.0))
        columns["log_durations"].values[1] = math.log(0.2)
        columns["motion"].values.zero_()
        columns["motion"].values[:, 0, 0] = torch.tensor([0.3, 0.0, -0.1, 0.2])
    assert by_motion(subject_of(model)).tolist() == [2, 3, 0, 1]
    with torch.no_grad():  # This one is gone for longer.
        columns["log_durations"].values[0] = math.log(0.05)
    assert by_motion(subject_of(model)).tolist() == [2, 3, 1, 0]
