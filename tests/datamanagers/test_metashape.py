"""The ``metashape`` format."""

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from plyfile import PlyData, PlyElement
from support.captures.metashape import CALIBRATION, DISTORTION, SCALE, SHIFT, TURN, write
from support.foreign_cameras import brown, equidistant, pixel_error, undistorted_error
from support.refusals import failure_of
from support.small_captures import (
    CENTER,
    FOCAL,
    HEIGHT,
    WIDTH,
    builder_of,
    projection_error,
    ring,
    write_image,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.metashape import MetashapeConfig

build = builder_of(MetashapeConfig)
failure = failure_of(build)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, ring()) < 0.01
    assert projection_error(build(tmp_path / "cameras.xml"), ring()) < 0.01
    assert projection_error(build(tmp_path, downscale=2.0), ring(), 0.5) < 0.01
    assert data.scene.up == "z"
    assert data.notes() == (
        f"{tmp_path}/cameras.xml: 4 cameras with a pose",
        "the world is Local Coordinates (m)",
        "there are no points (a PLY file in the data set would be used)",
        "held-out views: none (as asked for)",
    )


def test_a_chunk_without_transforms_is_its_own_world(tmp_path):
    write(tmp_path, components="", rest="")
    data = build(tmp_path)
    capture = ring()
    inner = replace(capture, points=(capture.points - SHIFT) @ TURN / SCALE)
    local = inner.points @ data.recording.frames[0].world_to_camera[:3, :3].numpy().T
    local += data.recording.frames[0].world_to_camera[:3, 3].numpy()
    seen = np.array(FOCAL) * local[:, :2] / local[:, 2:] + np.array(CENTER)
    assert np.abs(seen - capture.pixels(0)).max() < 1e-6
    assert "the chunk has no transform: its own coordinates are the world" in data.notes()
    assert data.scene.up == ""


def frame_formula(x, y):
    """Appendix "Camera models" of the manual, frame cameras; pixels from the corner."""
    k = [DISTORTION[f"k{power}"] for power in (1, 2, 3, 4)]
    x, y = brown(x, y, k, (DISTORTION["p1"], DISTORTION["p2"]))
    u = WIDTH * 0.5 + CALIBRATION["cx"] + x * CALIBRATION["f"] + x * CALIBRATION["b1"]
    return u, HEIGHT * 0.5 + CALIBRATION["cy"] + y * CALIBRATION["f"]


@pytest.mark.parametrize("kind", ["frame", "fisheye"])
def test_distorted_cameras_see_points_where_the_manual_says(tmp_path, kind):
    data = build(write(tmp_path, values=CALIBRATION | DISTORTION, kind=kind))
    bent = frame_formula if kind == "frame" else lambda x, y: frame_formula(*equidistant(x, y))
    assert pixel_error(data, ring(), bent) < 0.01
    assert undistorted_error(data, ring()) < 0.01
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape[1:3] == (batch.cameras.height, batch.cameras.width)


def test_cameras_without_a_pose_or_switched_off_are_left_out_with_a_note(tmp_path):
    write(tmp_path)
    file = tmp_path / "cameras.xml"
    extra = (
        '<camera id="7" sensor_id="0" label="lost"/>'
        '<camera id="9" sensor_id="0" master_id="2" label="second"/>'
        '<camera id="8" sensor_id="0" label="off" enabled="false"><transform>1</transform></camera>'
    )
    file.write_text(file.read_text().replace("<cameras>", f"<cameras><group>{extra}</group>"))
    notes = build(tmp_path).notes()
    assert "1 images that are disabled in Metashape are left out: off" in notes
    assert "1 images of a rig's slave cameras, which are not read, are left out: second" in notes
    assert "1 images that Metashape did not align are left out: lost" in notes


def test_only_components_that_share_a_world_are_used_together(tmp_path):
    write(tmp_path, components="")
    file = tmp_path / "cameras.xml"
    file.write_text(file.read_text().replace('component_id="0"', 'component_id="1"', 1))
    data = build(tmp_path)
    assert len(data.views(Split.TRAIN)) == 3
    assert (
        "used the 3 cameras of the largest of 2 components, which Metashape did not join; 1 "
        "cameras are left out" in data.notes()
    )


def test_points_beside_the_file_are_read(tmp_path):
    write(tmp_path)
    points = np.array([(1.0, 2.0, 3.0)], dtype=[(axis, "f4") for axis in "xyz"])
    for name in ("cloud.ply", "dense.ply"):
        PlyData([PlyElement.describe(points, "vertex")]).write(tmp_path / name)
    notes = build(tmp_path).notes()
    assert "no points are used; datamanager.points=FILE picks of cloud.ply, dense.ply" in notes
    data = build(tmp_path, {"points": "dense.ply"})
    assert data.recording.points.tolist() == [[1.0, 2.0, 3.0]]
    (tmp_path / "dense.ply").unlink()
    assert f"{tmp_path / 'cloud.ply'}: 1 points" in build(tmp_path).notes()
    with pytest.raises(DataError, match=r"datamanager.points=no.ply: there is no file"):
        build(tmp_path, {"points": "no.ply"})


def test_images_lie_beside_the_file_or_in_a_folder_that_is_named(tmp_path):
    write(tmp_path)
    (tmp_path / "images").rename(tmp_path / "photos")
    assert projection_error(build(tmp_path, {"images": "photos"}), ring()) < 0.01
    flat = replace(ring(), names=[f"photos/{name}" for name in ring().names])
    assert projection_error(build(tmp_path), flat) < 0.01
    write_image(tmp_path / "again/view_000.png")
    assert "view_000 can be any of 2 images in" in failure(tmp_path)
    assert "with datamanager.images=DIR." in failure(tmp_path)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"b2": 3.0}, "its skew b2 = 3 moves corners by 1 pixels, which no camera here can do."),
        ({"p3": 0.1}, "its tangential terms p3 = 0.1 and p4 = 0 cannot be used."),
        ({"f": -5.0}, "is no camera."),
        ({"f": float("nan")}, "f should be 1 numbers; found nan."),
        ({"cx": "left"}, "cx should be 1 numbers; found 'left'."),
    ],
)
def test_calibrations_that_cannot_be_used_are_refused(tmp_path, values, message):
    said = failure(write(tmp_path, values=CALIBRATION | values))
    assert said.startswith(f"sensor 0 of {tmp_path}/cameras.xml: ")
    assert message in said


def test_a_tiny_skew_is_left_out(tmp_path):
    assert (
        projection_error(build(write(tmp_path, values=CALIBRATION | {"b2": 1e-3})), ring()) < 0.01
    )


def test_malformed_files_are_refused(tmp_path):
    whole = (write(tmp_path) / "cameras.xml").read_text()
    for old, new, message in (
        ("</document>", "", "cannot be read as XML"),
        ('sensor_id="0"', 'sensor_id="3"', "there is no sensor 3."),
        ('type="frame"', 'type="spherical"', "images of spherical cameras cannot be trained on."),
        ("<f>", "<focal>", "cannot be read as XML"),
        (f"<scale>{SCALE}", "<scale>0", "the transform of the chunk: its scale is 0."),
        ("<camera ", '<camera enabled="0" ', "none of its 4 cameras is enabled and has a pose."),
        ("<transform>-", "<transform>x ", "transform should be 16 numbers"),
        ("<sensor ", "<sensors_ ", "cannot be read as XML"),
    ):
        (tmp_path / "cameras.xml").write_text(whole.replace(old, new))
        assert message in failure(tmp_path), old
    (tmp_path / "cameras.xml").write_text(whole.replace("<f>", "<g>").replace("</f>", "</g>"))
    assert "it has no calibration with a focal length f." in failure(tmp_path)


def test_a_file_of_markers_beside_the_cameras_is_none_of_cameras(tmp_path):
    """github.com/hwiyoung/MappingLocalization has both, of Metashape's document version 1.5.0."""
    write(tmp_path)
    text = (tmp_path / "cameras.xml").read_text()
    markers = re.sub(r"(?s)(<camera [^>]*>).*?</camera>", r"\1</camera>", text)
    assert markers.count("<camera ") == text.count("<camera ")
    (tmp_path / "markers.xml").write_text(markers)
    assert projection_error(build(tmp_path), ring()) < 0.01


def test_the_format_is_told_by_the_beginning_of_xml_files(tmp_path):
    (tmp_path / "other.xml").write_text("<calibration/>")
    assert not MetashapeConfig.detect(tmp_path).recognised
    assert "has to hold one XML file of Metashape's cameras; found none." in failure(tmp_path)
    write(tmp_path)
    assert MetashapeConfig.detect(tmp_path).found == "Metashape's cameras.xml"
    (tmp_path / "copy.xml").write_text((tmp_path / "cameras.xml").read_text())
    assert "found cameras.xml, copy.xml." in failure(tmp_path)


def test_a_folder_with_the_name_of_a_file_is_none(tmp_path):
    (write(tmp_path) / "other.xml").mkdir()
    assert len(build(tmp_path).views(Split.TRAIN)) == 4
