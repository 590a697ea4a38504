"""The measurement of the projection's accuracy: its scenes and its errors."""

import pytest
from projection_accuracy import camera_of, ladder, psnr, scene_of, splatting_evaluations


def test_nearer_gaussians_are_projected_worse():
    near, far = (ladder(camera_of(16, 16, 2.0 * d), 6, d) for d in (8.0, 64.0))
    assert near[0] < far[0] - 10, "projection"
    assert near[1] < far[1] - 10, "projection and sorting"


def test_scenes_are_within_the_image_and_of_the_size_that_is_asked_for():
    camera = camera_of(20, 10, 15.0)
    splats = scene_of(camera, 50, 30.0, seed=1)
    x, y, z = splats.means.unbind(1)
    assert (z > 0).all()
    assert ((15 * x / z).abs() <= 10).all()
    assert ((15 * y / z).abs() <= 5).all()
    ratio = splats.means.norm(dim=1) / splats.scales.amax(1)
    assert ratio.amin().item() == pytest.approx(30)
    assert ratio.amax().item() == pytest.approx(30)
    assert splatting_evaluations(splats, camera) % 64 == 0


def test_psnr_is_of_the_mean_over_all_scenes():
    assert psnr([(1.0, 50), (0.0, 50)]) == pytest.approx(20)
    assert psnr([(0.0, 50)]) == float("inf")
