"""Culling leaves out what is too faint at a time, and what no pixel shows leaves no trace."""

from dataclasses import replace

import torch
from support.moving_splats import at, spacetime
from support.scenes import front_camera, random_splats

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.tradeoff.edits import TemporalCulling
from gsfw.studies.tradeoff.subject import Subject


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
