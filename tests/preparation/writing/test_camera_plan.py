"""What becomes of lenses: which are straight enough, and what they are called."""

import numpy as np
import pytest
from support.distorted_images import HEIGHT, WIDTH, lens

from gsfw.preparation.writing.camera_plan import (
    STRAIGHT,
    CameraPlan,
    distortion_in_pixels,
    lens_words,
)


def test_a_lens_is_straight_where_it_moves_no_pixel_far():
    assert distortion_in_pixels(lens("PINHOLE", ())) == 0
    slight = lens("SIMPLE_RADIAL", (0.001,))
    reach = np.hypot(123.0, 93.0)
    assert distortion_in_pixels(slight) == pytest.approx(0.001 * reach**3 / 170**2, rel=0.02)
    plan = CameraPlan.of(slight, False)
    assert (plan.undistortion is None) == (distortion_in_pixels(slight) <= STRAIGHT)
    assert plan.undistortion is not None


def test_pixels_move_where_rays_fall():
    plan = CameraPlan.of(lens("OPENCV_FISHEYE"), False)
    slopes = np.array([[0.0, 0.0], [0.2, -0.1], [-0.3, 0.3]])
    moved, inside = plan.moved(plan.source.project(slopes))
    assert np.abs(moved - plan.target.project(slopes)).max() < 1e-6
    assert inside.all()
    _, inside = plan.moved(np.array([[0.5, 0.5], [WIDTH - 0.5, HEIGHT - 0.5]]))
    assert not inside.any()


def test_kept_lenses_move_nothing():
    plan = CameraPlan.of(lens("OPENCV"), True)
    pixels = np.array([[0.5, 0.5], [3.0, 4.0]])
    moved, inside = plan.moved(pixels)
    assert plan.target == plan.source
    assert np.array_equal(moved, pixels)
    assert inside.all()


def test_every_model_is_told():
    plans = [
        CameraPlan.of(lens(model, terms), False)
        for model, terms in (
            ("PINHOLE", ()),
            ("OPENCV", None),
            ("SIMPLE_RADIAL", (0.0,)),
            ("SIMPLE_RADIAL", (0.0,)),
        )
    ]
    lost = 100 * plans[1].undistortion.lost
    assert lens_words(plans) == (
        f"PINHOLE as given; PINHOLE, undistorted from OPENCV (up to {lost:.1f} % of an image fell "
        "outside); PINHOLE, as SIMPLE_RADIAL was almost straight"
    )
