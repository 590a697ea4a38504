"""Plane sweep: depths of a textured plane."""

from dataclasses import replace

import pytest
from support.textured_plane import DEPTH, views_of_a_plane

from gsfw.core.stereo.plane_sweep import sweep_views
from gsfw.core.stereo.plans import SweepPlan
from gsfw.core.stereo.views import StereoViews

MIDDLE = SweepPlan(1, (0, 2), 2.0, 10.0, 40)


def test_a_textured_plane_is_found_at_its_depth():
    (found,) = sweep_views(views_of_a_plane(), [MIDDLE])
    middle = (slice(6, -6), slice(8, -8))
    assert found.depths[middle].median() == pytest.approx(DEPTH, rel=0.02)
    assert (found.scores[middle] > 0.7).float().mean() > 0.9


def test_a_patch_without_texture_takes_the_depth_of_its_surroundings():
    views = views_of_a_plane()
    images = [image.clone() for image in views.colors]
    for image, center in zip(images, views.centers, strict=True):
        left = 24 - round(center[0].item() * 10.0)
        image[12:24, left : left + 12] = 0.4
    (found,) = sweep_views(replace(views, colors=tuple(images)), [MIDDLE])
    patch = found.depths[14:22, 22:30]
    assert ((patch - DEPTH).abs() < 0.05 * DEPTH).float().mean() > 0.9


def test_a_view_may_have_a_single_neighbour_of_another_size():
    views: StereoViews = views_of_a_plane(2, heights=(36, 20))
    (found,) = sweep_views(views, [SweepPlan(1, (0,), 2.0, 10.0, 40)])
    assert found.depths.shape == (20, 48)
    assert found.depths[4:-4, 4:-16].median() == pytest.approx(DEPTH, rel=0.02)
