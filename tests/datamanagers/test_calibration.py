"""Calibration files of several cameras."""

import json

import numpy as np
import pytest
from support.captures.calibrations import entry, write_json, write_qualisys, write_toml
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, rotation_vector
from support.small_videos import cameras

from gsfw.core.errors import DataError
from gsfw.datamanagers.calibration import read_calibration


def check(camera, number=0):
    assert camera.name == f"cam{number:02d}"
    lens = camera.lens
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == pytest.approx((*FOCAL, *CENTER))
    assert (lens.width, lens.height) == (WIDTH, HEIGHT)
    assert np.allclose(camera.world_to_camera, cameras().poses[number], atol=1e-12)


def test_cameras_are_read_with_pixels_counted_from_the_corner(tmp_path):
    found = read_calibration(write_json(tmp_path / "cameras.json", entry(1), entry(0)))
    check(found[0], 0)
    check(found[1], 1)
    assert found[0].lens.is_pinhole


def test_an_object_with_cameras_as_keys_is_read(tmp_path):
    content = {"a": entry(0, name=None), "metadata": {"error": 0.1}}
    (tmp_path / "calib.json").write_text(json.dumps(content))
    (camera,) = read_calibration(tmp_path / "calib.json")
    assert camera.name == "a"


def test_pose2sims_toml_is_read(tmp_path):
    (camera,) = read_calibration(write_toml(tmp_path / "Calib.toml"))
    check(camera)


@pytest.mark.parametrize(
    ("given", "model", "expected"),
    [
        ({"dist": [0.1, 0.2, 0.3, 0.4]}, "OPENCV", (0.1, 0.2, 0.3, 0.4)),
        ({"D": [0.1, 0.2, 0.3, 0.4, 0.5]}, "FULL_OPENCV", (0.1, 0.2, 0.3, 0.4, 0.5, 0, 0, 0)),
        ({"D": [0.1, 0.2, 0.3, 0.4], "fisheye": True}, "OPENCV_FISHEYE", (0.1, 0.2, 0.3, 0.4)),
        ({"dist": [0.0, 0.0, 0.0, 0.0]}, "PINHOLE", ()),
        ({"dist": []}, "PINHOLE", ()),
    ],
)  # fmt: skip
def test_opencvs_distortion_becomes_colmaps(tmp_path, given, model, expected):
    (camera,) = read_calibration(write_json(tmp_path / "cameras.json", entry(**given)))
    assert (camera.lens.model, camera.lens.distortion) == (model, expected)


def test_rotation_and_translation_may_be_apart(tmp_path):
    pose = cameras().poses[0]
    for rotation in (pose[:3, :3], np.array(rotation_vector(pose[:3, :3]))):
        parts = {"R": rotation.tolist(), "T": pose[:3, 3:].tolist(), "w2c": None}
        (camera,) = read_calibration(write_json(tmp_path / "cameras.json", entry(**parts)))
        check(camera)


def test_qualisys_files_are_read(tmp_path):
    (camera,) = read_calibration(write_qualisys(tmp_path / "a.qca.txt"))
    check(camera)
    assert camera.lens.distortion == (0.1, 0.2, 0.01, 0.02)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"viewrotation": 90}, r"a\.qca\.txt: camera cam00 is turned by 90 degrees"),
        ({"viewrotation": "up"}, r"viewrotation is 'up'; expected degrees"),
        ({"fu": "wide"}, r"its intrinsic lacks one of focalLengthU, focalLengthV"),
    ],
)
def test_qualisys_files_that_cannot_be_used_are_refused(tmp_path, settings, message):
    with pytest.raises(DataError, match=message):
        read_calibration(write_qualisys(tmp_path / "a.qca.txt", **settings))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"K": None},
            r"cameras\.json: camera cam00: K or matrix or .* is missing; expected 3 x 3 finite",
        ),
        ({"K": [[1.0]]}, r"K: expected 3 x 3 finite numbers, found \[\[1\.0\]\]"),
        ({"w": None}, r"size or .* is missing; expected 2 finite"),
        ({"w": "wide"}, r"w: expected one finite number, found 'wide'"),
        ({"w2c": None}, r"rotation or R or rvec is missing; expected 3 x 3 or 3 or 3 x 1 or 1 x 3"),
        ({"w2c": np.diag([1.0, 1, -1, 1]).tolist()}, r"the pose is mirrored"),
        (
            {"w2c": np.diag([1.0, 1, np.inf, 1]).tolist()},
            r"w2c\[2\]\[2\]: expected one finite number, found inf",
        ),
        (
            {"dist": [0.1, 0.2]},
            r"dist: expected 0 or 4 or 5 or 8 finite numbers, found \[0\.1, 0\.2\]",
        ),
        ({"w": 0}, r"is no camera"),
        ({"w": np.inf}, r"w: expected one finite number, found inf"),
        ({"w": None, "size": [WIDTH, np.nan]}, r"size\[1\]: expected one finite number, found nan"),
        ({"w": 10**400}, r"w: expected one finite number, found 10+"),
    ],
)
def test_cameras_that_are_none_are_refused(tmp_path, settings, message):
    with pytest.raises(DataError, match=message):
        read_calibration(write_json(tmp_path / "cameras.json", entry(**settings)))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cameras.json", '{"cameras": [', r"cameras\.json cannot be read"),
        ("cameras.json", "[]", r"cameras\.json contains no cameras"),
        ("cameras.json", "3", r"cameras\.json contains no cameras"),
        ("Calib.toml", "a = " + "[" * 20_000, r"Calib\.toml cannot be read"),
        ("a.qca.txt", "<calibration>", r"a\.qca\.txt cannot be read as XML"),
        ("a.qca.txt", "<calibration/>", r"a\.qca\.txt contains no cameras"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(DataError, match=message):
        read_calibration(tmp_path / name)


def test_both_files_of_people_video_say_the_same(shared_data):
    folder = shared_data / "dynamic/people_video"
    pairs = zip(
        read_calibration(folder / "cameras_opencv.json"),
        read_calibration(folder / "Calib.qca.txt"),
        strict=True,
    )
    for json_camera, xml_camera in pairs:
        assert json_camera.name == xml_camera.name
        assert json_camera.lens == xml_camera.lens
        assert np.allclose(json_camera.world_to_camera, xml_camera.world_to_camera, atol=1e-6)
