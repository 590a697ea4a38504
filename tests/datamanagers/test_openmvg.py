"""The ``openmvg`` format."""

import numpy as np
import pytest
import torch
from support.captures.openmvg import BASE, scene, wrapped, write
from support.foreign_cameras import brown, equidistant, pixel_error, undistorted_error
from support.refusals import failure_of
from support.small_captures import CENTER, FOCAL, builder_of, projection_error, ring, square

from gsfw.core.datamanager import Split
from gsfw.datamanagers.openmvg import OpenMvgConfig

build = builder_of(OpenMvgConfig)
failure = failure_of(build)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, square(ring())) < 0.01
    assert projection_error(build(tmp_path / "sfm_data.json"), square(ring())) < 0.01
    assert projection_error(build(tmp_path, downscale=2.0), square(ring()), 0.5) < 0.01
    assert np.allclose(data.recording.points, ring().points)
    assert data.recording.point_colors.unique().tolist() == [0.5]
    assert data.notes()[0] == f"{tmp_path}/sfm_data.json: 4 views, 20 points"


def test_images_are_where_the_file_says_or_beside_it(tmp_path):
    elsewhere = tmp_path / "far/photos"
    write(tmp_path / "set", scene(root_path=str(elsewhere)), images="../far/photos")
    assert projection_error(build(tmp_path / "set"), square(ring())) < 0.01
    elsewhere.rename(tmp_path / "set/photos")
    assert projection_error(build(tmp_path / "set"), square(ring())) < 0.01


def pixels(x, y):
    """Counted from the corner, half a pixel from where OpenMVG counts."""
    return FOCAL[0] * x + CENTER[0], FOCAL[0] * y + CENTER[1]


@pytest.mark.parametrize(
    ("kind", "terms", "bend"),
    [
        ("pinhole_radial_k1", {"disto_k1": [-0.1]}, lambda x, y: brown(x, y, [-0.1])),
        (
            "pinhole_radial_k3",
            {"disto_k3": [-0.1, 0.05, -0.02]},
            lambda x, y: brown(x, y, [-0.1, 0.05, -0.02]),
        ),
        (
            "pinhole_brown_t2",
            {"disto_t2": [-0.1, 0.05, -0.02, 2e-3, -3e-3]},
            lambda x, y: brown(x, y, [-0.1, 0.05, -0.02], (-3e-3, 2e-3)),
        ),
        (
            "fisheye",
            {"fisheye": [0.1, -0.05, 0.02, 0.01]},
            lambda x, y: brown(*equidistant(x, y), [0.1, -0.05, 0.02, 0.01]),
        ),
    ],
)
@pytest.mark.parametrize("nested", [False, True])
def test_distorted_cameras_see_points_where_the_formula_says(tmp_path, kind, terms, bend, nested):
    data = {"value0": BASE, **terms} if nested else BASE | terms
    loaded = build(write(tmp_path, scene(data, kind)))
    assert pixel_error(loaded, ring(), lambda x, y: pixels(*bend(x, y))) < 0.01
    assert undistorted_error(loaded, ring()) < 0.01
    (batch,) = loaded.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape[1:3] == (batch.cameras.height, batch.cameras.width)


def test_a_types_name_is_given_once(tmp_path):
    content = scene(BASE | {"disto_k1": [0.1]}, "pinhole_radial_k1")
    content["intrinsics"].append(wrapped(1, BASE, 1))
    assert "intrinsic 1: cameras of the type" in failure(write(tmp_path, content))
    assert "cameras of the type pinhole_radial_k1 cannot be used." in failure(tmp_path)


def test_panoramas_are_refused(tmp_path):
    content = scene({"width": 64, "height": 32}, "spherical")
    assert "images of spherical cameras cannot be trained on." in failure(write(tmp_path, content))


def test_views_without_a_pose_are_left_out_with_a_note(tmp_path):
    data = build(write(tmp_path, scene(extrinsics=scene()["extrinsics"][:3])))
    assert len(data.views(Split.TRAIN)) == 3
    assert "1 images without a pose are left out: view_003.png" in data.notes()


def test_missing_images_are_noted(tmp_path):
    write(tmp_path)
    (tmp_path / "images/view_001.png").unlink()
    assert "1 of 4 images are not on disk and are left out: view_001.png" in build(tmp_path).notes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (scene(views=3), "views: expected a list of objects, found 3."),
        (scene(extrinsics=[]), "none of its 4 views has a pose."),
        (scene(intrinsics=[]), "id_intrinsic: expected a key of intrinsics, found 0."),
        (scene(extrinsics=[{"key": 0, "value": {"center": [0, 0, 0]}}]),
         "view view_000.png: rotation is missing; expected 3 x 3 finite numbers."),
        (scene(BASE | {"principal_point": [1]}), "principal_point: expected 2 finite numbers"),
        (scene(BASE | {"focal_length": "50mm"}), "focal_length: expected one finite number"),
        (scene(BASE | {"disto_k3": [1, 2]}), "disto_k3: expected 3 finite numbers, found [1, 2]."),
        (scene(BASE, "pinhole_bent"), "cameras of the type pinhole_bent cannot be used."),
    ],
)  # fmt: skip
def test_malformed_files_are_refused(tmp_path, content, message):
    assert message in failure(write(tmp_path, content))


def test_binary_files_lead_to_openmvgs_converter(tmp_path):
    (tmp_path / "sfm_data.bin").touch()
    assert not OpenMvgConfig.detect(tmp_path).recognised
    assert "openMVG_main_ConvertSfM_DataFormat -i sfm_data.bin" in failure(tmp_path)
    assert OpenMvgConfig.detect(tmp_path).found.startswith("sfm_data.bin; write it as JSON")


def test_the_format_is_told_by_its_name(tmp_path):
    assert failure(tmp_path).startswith(f"{tmp_path} contains no sfm_data.json.")
    assert OpenMvgConfig.detect(write(tmp_path)).found == "sfm_data.json"


def test_keys_and_folders_that_can_be_none_end_in_words(tmp_path):
    content = scene(root_path="x" * 5000)
    assert len(build(write(tmp_path, content)).views(Split.TRAIN)) == 4
    content["views"][0]["value"]["ptr_wrapper"]["data"]["id_pose"] = [0]
    write(tmp_path, content)
    assert len(build(tmp_path).views(Split.TRAIN)) == 3
    content["views"][2]["value"]["ptr_wrapper"]["data"]["id_intrinsic"] = {"a": 0}
    assert "id_intrinsic: expected a key of intrinsics" in failure(write(tmp_path, content))
    content["extrinsics"][1]["key"] = [1]
    assert "extrinsics[1]: key: expected a number, found [1]." in failure(write(tmp_path, content))
