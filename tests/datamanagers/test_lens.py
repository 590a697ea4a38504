"""Lenses of COLMAP's models."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pycolmap
import pytest
from support.distorted_images import DISTORTIONS, PINHOLES, lens, parameters, slopes_on_grid

from gsfw.core.errors import DataError
from gsfw.datamanagers.lens import COEFFICIENTS, Lens

LENS = Lens(70.0, 72.0, 31.0, 25.5, 64, 48, "camera 1 of cameras.bin")


def refusal(**broken) -> str:
    with pytest.raises(DataError) as error:
        replace(LENS, **broken).check()
    return str(error.value)


def opencv(x, y, k1, k2, p1, p2):
    """Brown's model as OpenCV's manual has it."""
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def opencv_fisheye(x, y, k1, k2, k3, k4):
    """Kannala and Brandt's model (2006) as OpenCV's manual has it."""
    r = np.hypot(x, y)
    theta = np.arctan(r)
    bent = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
    return x * bent / r, y * bent / r


@pytest.mark.parametrize(
    ("model", "formula"), [("OPENCV", opencv), ("OPENCV_FISHEYE", opencv_fisheye)]
)
def test_rays_fall_where_the_formula_says(model, formula):
    camera = lens(model)
    x, y = formula(*slopes_on_grid().T, *camera.distortion)
    wanted = np.stack([camera.fx * x + camera.cx, camera.fy * y + camera.cy], axis=1)
    np.testing.assert_allclose(camera.project(slopes_on_grid()), wanted, atol=1e-9)


@pytest.mark.parametrize("model", DISTORTIONS)
def test_rays_fall_where_colmap_says_and_lead_back(model):
    camera, slopes = lens(model), slopes_on_grid()
    colmap = pycolmap.Camera(
        model=model, width=camera.width, height=camera.height, params=parameters(camera)
    )
    pixels = camera.project(slopes)
    rays = np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)
    np.testing.assert_allclose(pixels, colmap.img_from_cam(rays), atol=1e-9)
    np.testing.assert_allclose(camera.unproject(pixels), slopes, atol=1e-9)


def test_every_model_of_colmap_with_a_lens_is_known():
    without = {"INVALID", "EQUIRECTANGULAR"}
    assert set(pycolmap.CameraModelId.__members__) - without == COEFFICIENTS.keys()
    assert COEFFICIENTS.keys() == DISTORTIONS.keys() | PINHOLES.keys()


def test_models_of_one_focal_length_may_have_two():
    camera = replace(lens("SIMPLE_RADIAL"), fy=190.0)
    square = lens("SIMPLE_RADIAL")
    pixels, wanted = camera.project(slopes_on_grid()), square.project(slopes_on_grid())
    np.testing.assert_allclose(pixels[:, 0], wanted[:, 0])
    ratio = 190.0 / square.fy
    np.testing.assert_allclose(pixels[:, 1] - camera.cy, ratio * (wanted[:, 1] - camera.cy))


@pytest.mark.parametrize("model", ["FISHEYE", "OPENCV_FISHEYE"])
def test_pixels_that_no_ray_in_front_of_the_camera_reaches_have_none(model):
    camera = lens(model)
    behind = np.array([[camera.cx + 2.0 * camera.fx, camera.cy], [camera.cx, camera.cy]])
    slopes = camera.unproject(behind)
    assert np.isnan(slopes[0]).all()
    assert slopes[1].tolist() == [0.0, 0.0]


def test_lenses_without_distortion_are_pinholes_unless_they_are_fisheyes():
    zeros = {model: (0.0,) * len(names) for model, names in COEFFICIENTS.items()}
    straight = {model for model, zero in zeros.items() if lens(model, zero).is_pinhole}
    fisheyes = {model for model in COEFFICIENTS if "FISHEYE" in model}
    assert straight == COEFFICIENTS.keys() - fisheyes - {"EUCM"}
    assert not any(lens(model).is_pinhole for model in DISTORTIONS)
    np.testing.assert_allclose(LENS.project(np.array([[0.1, -0.2]])), [[38.0, 11.1]])


def test_a_lens_of_a_smaller_image_sees_the_same_rays():
    camera = lens("OPENCV")
    small = camera.resized(camera.width // 3, camera.height // 2)
    wanted = camera.project(slopes_on_grid()) / (3, 2)
    np.testing.assert_allclose(small.project(slopes_on_grid()), wanted)
    assert (small.width, small.height) == (camera.width // 3, camera.height // 2)


@pytest.mark.parametrize("broken", [{"fx": 0.0}, {"cx": math.nan}, {"width": 0}])
def test_numbers_that_are_no_camera_are_refused(broken):
    assert refusal(**broken).startswith("camera 1 of cameras.bin: fx=")
    assert "is no camera.\nFocal lengths and sizes have to be positive" in refusal(**broken)


def test_models_that_are_unknown_are_refused_with_those_that_are_not():
    assert refusal(model="EQUIRECTANGULAR").startswith(
        "camera 1 of cameras.bin: cameras of the model EQUIRECTANGULAR cannot be used.\n"
        "Expected one of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, "
    )


def test_a_wrong_number_of_parameters_is_refused():
    assert refusal(model="OPENCV", distortion=(0.1, 0.2)) == (
        "camera 1 of cameras.bin: 2 distortion parameters for the model OPENCV.\n"
        "Expected 4 (k1, k2, p1, p2)."
    )
    assert refusal(distortion=(0.1,)) == (
        "camera 1 of cameras.bin: 1 distortion parameters for the model PINHOLE.\nRemove them."
    )


def test_parameters_that_are_not_finite_are_refused():
    assert refusal(model="RADIAL", distortion=(0.1, math.inf)) == (
        "camera 1 of cameras.bin: its distortion, RADIAL (k1=0.1, k2=inf), is not finite.\n"
        "Estimate the camera again."
    )


def test_a_model_that_an_old_pycolmap_lacks_names_the_way_out(monkeypatch):
    monkeypatch.setattr(pycolmap, "CameraModelId", SimpleNamespace(__members__={}))
    with pytest.raises(DataError) as error:
        lens("EUCM").project(slopes_on_grid())
    assert str(error.value) == (
        f"camera 1: pycolmap {pycolmap.__version__} does not know cameras of the model EUCM.\n"
        "Install a newer one: pip install -U pycolmap."
    )


@pytest.mark.parametrize(
    "broken", [{"fx": 1e-310}, {"fy": 1e300}, {"cx": -1e300}, {"cy": 1e300}], ids=str
)
def test_a_focal_length_that_float32_does_not_hold_is_refused(broken):
    assert "is no camera." in refusal(**broken)
