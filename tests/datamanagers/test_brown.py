"""Brown lenses in COLMAP's models."""

import numpy as np
import pytest
from support.foreign_cameras import brown

from gsfw.core.errors import DataError
from gsfw.datamanagers.brown import brown_lens, fisheye_lens
from gsfw.datamanagers.lens import Lens

PINHOLE = Lens(800.0, 810.0, 502.0, 371.0, 1000, 750, "camera 1")
STEPS = np.linspace(-0.6, 0.6, 40)
X, Y = (grid.flatten() for grid in np.meshgrid(STEPS, STEPS * 0.75))


def error(radial, tangential) -> float:
    lens = brown_lens(PINHOLE, radial, tangential)
    x, y = brown(X, Y, radial, tangential[::-1])
    wanted = np.stack([800 * x + 502, 810 * y + 371], axis=1)
    inside = ((wanted >= 0) & (wanted <= (1000, 750))).all(axis=1)
    found = lens.project(np.stack([X, Y], axis=1))
    return float(np.abs(found - wanted)[inside].max())


@pytest.mark.parametrize(
    ("radial", "tangential", "model"),
    [
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0), "PINHOLE"),
        ((-0.1, 0.05, 0.0, 0.0), (0.002, -0.003), "OPENCV"),
        ((-0.1, 0.05, -0.02, 0.0), (0.002, -0.003), "FULL_OPENCV"),
        ((-0.1, 0.05, -0.02, 0.015), (0.002, -0.003), "FULL_OPENCV"),
        ((0.05, -0.2, 0.3, -0.15), (0.0, 0.0), "FULL_OPENCV"),
        ((0.0, 0.0, 0.0, 1e-3), (0.0, 0.0), "FULL_OPENCV"),
    ],
)
def test_points_fall_where_the_formula_says(radial, tangential, model):
    assert brown_lens(PINHOLE, radial, tangential).model == model
    assert error(radial, tangential) < 0.01


def test_four_radial_terms_that_no_model_can_follow_are_refused():
    with pytest.raises(DataError) as caught:
        brown_lens(PINHOLE, (0.1, -0.3, 0.5, -0.4), (0.0, 0.0))
    assert str(caught.value) == (
        "camera 1: its four radial terms k1 to k4 = [0.1, -0.3, 0.5, -0.4] cannot be written as "
        "one of COLMAP's models.\n"
        "Estimate the cameras again without k4, or export undistorted images."
    )


def test_numbers_that_are_not_finite_are_refused():
    with pytest.raises(DataError, match=r"camera 1: its distortion .* is not finite"):
        brown_lens(PINHOLE, (float("nan"), 0.0, 0.0, 0.0), (0.0, 0.0))


def test_a_fisheye_with_tangential_terms_is_a_thin_prism_without_prism():
    lens = fisheye_lens(PINHOLE, (0.1, 0.2, 0.3, 0.4), (0.01, 0.02))
    assert lens.model == "THIN_PRISM_FISHEYE"
    assert lens.distortion == (0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.0, 0.0)
    assert fisheye_lens(PINHOLE, (0.0,) * 4, (0.0, 0.0)).model == "OPENCV_FISHEYE"
