"""Undistortion: which undistorted camera stands for a distorted one."""

import math
from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from support.distorted_images import CENTER, DISTORTIONS, HEIGHT, WIDTH, lens, parameters

from gsfw.core.errors import DataError
from gsfw.datamanagers.lens import COEFFICIENTS
from gsfw.datamanagers.undistortion import (
    LensRule,
    Undistortion,
    undistortion_notes,
    undistortion_of,
)

USUAL = LensRule()
WHOLE = LensRule(blank_pixels=1.0)
KEPT = LensRule(keep_fisheye=True)
WIDE = replace(lens("FISHEYE"), fx=WIDTH / math.pi, fy=WIDTH / math.pi)
"""Of 180 degrees across."""


def every_pixel(undistortion: Undistortion):
    """Where each pixel comes from, and whether the lens saw it."""
    target = undistortion.target
    x, y = np.meshgrid(np.arange(target.width) + 0.5, np.arange(target.height) + 0.5)
    return undistortion.look(np.stack([x.ravel(), y.ravel()], axis=1))


def inside(pixels: np.ndarray) -> np.ndarray:
    return ((pixels >= 0) & (pixels <= (WIDTH, HEIGHT))).all(axis=1)


@pytest.mark.parametrize("model", DISTORTIONS)
def test_usually_every_pixel_was_seen_and_little_is_lost(model):
    undistortion = undistortion_of(lens(model), USUAL)
    pixels, _ = every_pixel(undistortion)
    assert inside(pixels).all()
    assert not undistortion.has_blanks
    assert undistortion.lost < 0.08
    assert undistortion.target.model == "PINHOLE"
    assert (undistortion.target.fx, undistortion.target.fy) == (lens(model).fx, lens(model).fy)


@pytest.mark.parametrize("model", DISTORTIONS)
def test_with_blanks_nothing_is_lost_and_what_was_not_seen_is_told(model):
    undistortion = undistortion_of(lens(model), WHOLE)
    pixels, seen = every_pixel(undistortion)
    assert undistortion.lost == 0
    assert undistortion.has_blanks
    assert 0.5 < seen.mean() < 1
    np.testing.assert_array_equal(seen, inside(pixels))


@pytest.mark.parametrize("model", DISTORTIONS)
@pytest.mark.parametrize("blank", [0.0, 1.0])
def test_a_lens_that_looks_through_the_middle_is_cut_as_colmap_cuts_it(model, blank):
    camera = lens(model)
    values = zip(COEFFICIENTS[model], camera.distortion, strict=True)
    radial = tuple(0.0 if name[0] in "ps" else value for name, value in values)
    camera = replace(camera, cx=WIDTH / 2, cy=HEIGHT / 2, distortion=radial)
    options = pycolmap.UndistortCameraOptions()
    options.blank_pixels = blank
    wanted = pycolmap.undistort_camera(
        options, pycolmap.Camera(model=model, width=WIDTH, height=HEIGHT, params=parameters(camera))
    )
    found = undistortion_of(camera, LensRule(blank_pixels=blank, field_of_view=150.0)).target
    # COLMAP cuts at the middles of the outermost pixels, and rounds down.
    assert abs(found.width - wanted.width) <= 3
    assert abs(found.height - wanted.height) <= 3
    assert abs(found.cx - found.width / 2) < 0.01
    assert abs(found.cy - found.height / 2) < 0.01


def test_a_lens_beside_the_middle_keeps_more_than_colmap_does():
    camera = lens("OPENCV")
    wanted = pycolmap.undistort_camera(
        pycolmap.UndistortCameraOptions(),
        pycolmap.Camera(model="OPENCV", width=WIDTH, height=HEIGHT, params=parameters(camera)),
    )
    found = undistortion_of(camera, USUAL)
    assert found.target.width > wanted.width
    assert found.target.height >= wanted.height
    assert inside(every_pixel(found)[0]).all()


def test_a_principal_point_outside_the_image_is_no_obstacle():
    undistortion = undistortion_of(replace(lens("OPENCV"), cx=-40.0), USUAL)
    assert undistortion.target.cx < -30
    assert undistortion.lost < 0.12
    assert inside(every_pixel(undistortion)[0]).all()


def test_a_pinhole_of_another_name_keeps_its_size():
    target = undistortion_of(lens("FULL_OPENCV", (0.0,) * 8), USUAL).target
    assert (target.width, target.height) == (WIDTH, HEIGHT)
    assert (target.cx, target.cy) == pytest.approx(CENTER)


def test_the_field_of_view_of_a_pinhole_has_a_limit():
    for degrees in (100.0, 120.0):
        rule = LensRule(field_of_view=degrees)
        undistortion = undistortion_of(replace(WIDE, cx=WIDTH / 2), rule)
        across = math.degrees(2 * math.atan(undistortion.target.width / 2 / WIDE.fx))
        assert across == pytest.approx(degrees, abs=0.5)
        assert undistortion.lost > 0.3


def test_a_wide_fisheye_that_is_kept_loses_only_what_is_almost_behind_it():
    undistortion = undistortion_of(WIDE, KEPT)
    assert undistortion.target.model == "FISHEYE"
    assert undistortion.has_blanks
    assert undistortion.lost < 0.25
    pixels, seen = every_pixel(undistortion)
    angles = np.linalg.norm(pixels - CENTER, axis=1) / WIDE.fx
    assert math.degrees(angles[seen].max()) == pytest.approx(85, abs=0.5)
    assert not seen[angles > math.radians(85)].any()


def test_an_ideal_fisheye_that_is_kept_stays_as_it_is():
    undistortion = undistortion_of(lens("FISHEYE"), KEPT)
    assert (undistortion.target.width, undistortion.target.height) == (WIDTH, HEIGHT)
    pixels, _ = every_pixel(undistortion)
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([x.ravel(), y.ravel()], axis=1), atol=1e-6)


def test_lenses_that_are_no_fisheyes_become_pinholes_whatever_fisheyes_do():
    assert undistortion_of(lens("OPENCV"), KEPT).target.model == "PINHOLE"


@pytest.mark.parametrize("blank", [0.0, 1.0])
@pytest.mark.parametrize(
    ("model", "distortion", "reach"),
    [("SIMPLE_RADIAL", (-1.5,), 53), ("OPENCV_FISHEYE", (-0.7, 0.0, 0.0, 0.0), 78)],
)
def test_a_distortion_that_folds_the_image_over_is_refused(model, distortion, reach, blank):
    camera = lens(model, distortion)
    with pytest.raises(DataError) as error:
        undistortion_of(camera, LensRule(blank_pixels=blank))
    assert str(error.value) == (
        f"camera 1: its distortion, {camera}, folds the image over: no ray falls further than "
        f"about {reach} pixels from the principal point, but the corners are 154 pixels from it.\n"
        "Estimate the cameras again with a model that fits the lens (OPENCV_FISHEYE for very wide "
        "ones), or with fewer parameters (SIMPLE_RADIAL)."
    )


@pytest.mark.parametrize("value", [1e3, -1e3, 1e300, -1e300])
@pytest.mark.parametrize("model", [model for model in DISTORTIONS if DISTORTIONS[model]])
def test_absurd_distortions_are_refused_or_bounded(model, value):
    camera = lens(model, (value,) * len(DISTORTIONS[model]))
    try:
        target = undistortion_of(camera, WHOLE).target
    except DataError:
        return
    assert target.width <= 2 * WIDTH
    assert target.height <= 2 * HEIGHT


def test_a_lens_that_leaves_next_to_nothing_is_refused():
    camera = lens("SIMPLE_RADIAL", (400.0,))
    with pytest.raises(DataError) as error:
        undistortion_of(camera, USUAL)
    assert str(error.value) == (
        "camera 1: undistorting SIMPLE_RADIAL (k1=400) would leave 33x24 of 240x180 pixels.\n"
        "Estimate the camera again, show more (a larger datamanager.field_of_view, or "
        "datamanager.blank_pixels=1) or, for a fisheye, use datamanager.fisheye=keep."
    )


def test_notes_say_what_became_of_which_images():
    plain, fisheye = undistortion_of(lens("OPENCV"), USUAL), undistortion_of(WIDE, KEPT)
    assert undistortion_notes([]) == ()
    assert undistortion_notes([plain, plain, fisheye]) == (
        "2 images of 1 lens undistorted from OPENCV to PINHOLE (254x186 pixels), for "
        f"training, evaluation and export; up to {100 * plain.lost:.1f} % of an image fall "
        "outside",
        "1 image of 1 lens undistorted from FISHEYE to FISHEYE "
        f"({fisheye.target.width}x{fisheye.target.height} pixels), for training, evaluation and "
        f"export; up to {100 * fisheye.lost:.1f} % of an image fall outside, and pixels that no "
        "lens saw are masked out",
    )
