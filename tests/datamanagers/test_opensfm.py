"""The ``opensfm`` format."""

import json

import numpy as np
import pytest
import torch
from PIL import Image
from PIL.ExifTags import Base
from support.captures.opensfm import BROWN, LONGER, TERMS, reconstruction, write
from support.foreign_cameras import brown, equidistant, pixel_error, undistorted_error
from support.refusals import failure_of
from support.small_captures import HEIGHT, WIDTH, builder_of, projection_error, ring, write_images

from gsfw.core.datamanager import Split
from gsfw.datamanagers.opensfm import OpenSfmConfig

build = builder_of(OpenSfmConfig)
failure = failure_of(build)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, ring()) < 0.01
    assert projection_error(build(tmp_path / "reconstruction.json"), ring()) < 0.01
    assert projection_error(build(tmp_path, downscale=2.0), ring(), 0.5) < 0.01
    assert data.scene.up == "z"
    assert np.allclose(data.recording.points, ring().points)
    assert np.allclose(data.recording.point_colors, ring().colors / 255)
    assert data.notes()[0] == f"{tmp_path}/reconstruction.json: 4 shots, 20 points"


def test_numbers_are_those_of_any_size_of_the_image(tmp_path):
    camera = BROWN | {"width": WIDTH * 3 // 2, "height": HEIGHT * 3 // 2}
    assert projection_error(build(write(tmp_path, reconstruction(camera))), ring()) < 0.01
    turned = BROWN | {"width": HEIGHT, "height": WIDTH}
    said = failure(write(tmp_path, reconstruction(turned)))
    assert "view_000.png is 64x48 pixels, but " in said
    assert ": camera v2 unknown" in said


@pytest.mark.parametrize("factor", [1, 2])
def test_cameras_describe_images_as_stored(tmp_path, factor):
    """Portrait photos of OpenSfM 0.5 (github.com/arjunkurup/sfm-data-bathtub) are stored sideways.

    Its shots have "orientation": 6, and its cameras the size of the stored images.
    """
    write(tmp_path)
    for file in (tmp_path / "images").iterdir():
        exif = Image.Exif()
        exif[Base.Orientation] = 6
        Image.open(file).resize((WIDTH // factor, HEIGHT // factor)).save(file, exif=exif)
    data = build(tmp_path)
    for frame in data.recording.frames:
        pose = frame.world_to_camera.numpy()
        local = ring().points @ pose[:3, :3].T + pose[:3, 3]
        u, v = ring().pixels(ring().names.index(frame.name), 1 / factor).T
        seen = frame.lens.project(local[:, :2] / local[:, 2:])
        assert np.allclose(seen, np.stack([HEIGHT / factor - v, u], axis=1), atol=0.01)


def test_opendronemaps_folders_are_known(tmp_path):
    write_images(tmp_path / "images", ring())
    (tmp_path / "opensfm").mkdir()
    content = json.dumps([reconstruction()])
    (tmp_path / "opensfm/reconstruction.json").write_text(content)
    assert projection_error(build(tmp_path), ring()) < 0.01
    assert projection_error(build(tmp_path / "opensfm"), ring()) < 0.01


def pixels(x, y):
    x, y = BROWN["focal_x"] * x + BROWN["c_x"], BROWN["focal_y"] * y + BROWN["c_y"]
    return x * LONGER + WIDTH / 2, y * LONGER + HEIGHT / 2


def brown_formula(x, y):
    """OpenSfM's Disto246 and tangential terms: p2 on r^2 + 2 x^2."""
    k = [TERMS[f"k{power}"] for power in (1, 2, 3)]
    return pixels(*brown(x, y, k, (TERMS["p2"], TERMS["p1"])))


def fisheye_formula(x, y):
    return pixels(*brown(*equidistant(x, y), (0.1, -0.05, 0.02, 0.01)))


@pytest.mark.parametrize(
    ("camera", "formula"),
    [
        (BROWN | TERMS, brown_formula),
        (
            BROWN | {"projection_type": "fisheye_opencv"}
            | {"k1": 0.1, "k2": -0.05, "k3": 0.02, "k4": 0.01},
            fisheye_formula,
        ),
        (
            BROWN | {"projection_type": "fisheye62", "k1": 0.1, "k2": -0.05, "k3": 0.02}
            | {"k4": 0.01, "k5": 0.0, "k6": 0.0, "p1": 0.0, "p2": 0.0},
            fisheye_formula,
        ),
    ],
)  # fmt: skip
def test_distorted_cameras_see_points_where_the_formula_says(tmp_path, camera, formula):
    data = build(write(tmp_path, reconstruction(camera)))
    assert pixel_error(data, ring(), formula) < 0.01
    assert undistorted_error(data, ring()) < 0.01
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape[1:3] == (batch.cameras.height, batch.cameras.width)


@pytest.mark.parametrize(
    ("kind", "bend"), [("perspective", lambda x, y: (x, y)), ("fisheye", equidistant)]
)
def test_old_types_have_one_focal_length_and_two_terms(tmp_path, kind, bend):
    camera = {"projection_type": kind, "width": WIDTH, "height": HEIGHT, "focal": 1.1}
    camera |= {"k1": -0.1, "k2": 0.05}

    def formula(x, y):
        x, y = brown(*bend(x, y), (-0.1, 0.05))
        return 1.1 * LONGER * x + WIDTH / 2, 1.1 * LONGER * y + HEIGHT / 2

    data = build(write(tmp_path, reconstruction(camera)))
    assert pixel_error(data, ring(), formula) < 0.01


def test_the_largest_reconstruction_is_used(tmp_path):
    reference = {"latitude": 52.5, "longitude": 13.4, "altitude": 34.0}
    write(tmp_path, reconstruction(views=1), reconstruction(views=3, reference_lla=reference))
    data = build(tmp_path)
    assert len(data.views(Split.TRAIN)) == 3
    notes = data.notes()
    assert "used the largest of 2 reconstructions; 1 shots of the others are left out" in notes
    assert (
        "the world is metres to the east, north and up of latitude 52.5, longitude 13.4, altitude "
        "34.0" in notes
    )


def test_missing_images_are_noted(tmp_path):
    write(tmp_path)
    (tmp_path / "images/view_001.png").unlink()
    assert "1 of 4 images are not on disk and are left out: view_001.png" in build(tmp_path).notes()


def test_a_reconstruction_without_points_starts_from_none(tmp_path):
    data = build(write(tmp_path, reconstruction(points={})))
    assert len(data.recording.points) == 0
    assert "there are no points (a PLY file in the data set would be used)" in data.notes()


def changed(**settings):
    """A reconstruction whose first shot is different."""
    content = reconstruction()
    content["shots"]["view_000.png"] |= settings
    return content


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (reconstruction(shots={}), "reconstruction.json contains no shots"),
        (reconstruction(cameras=3), "[0]: cameras: expected an object, found 3."),
        (changed(camera="other"), "camera: expected a name in cameras, found 'other'."),
        (changed(rotation=[1, 2]), "shot view_000.png: rotation: expected 3 finite numbers"),
        (changed(translation=None), "translation: expected 3 finite numbers, found nothing."),
        (reconstruction(BROWN | {"projection_type": "spherical"}),
         "images of spherical cameras cannot be trained on."),
        (reconstruction(BROWN | {"projection_type": "fisheye624", "s1": 0.1}),
         "the tangential and thin prism terms of fisheye624 cannot be used."),
        (reconstruction(BROWN | {"focal_x": None}), "focal_x: expected one finite number"),
        (reconstruction(points={"1": {"coordinates": [1, 2]}}),
         "[0]: points: 1: coordinates: expected 3 finite numbers"),
    ],
)  # fmt: skip
def test_malformed_files_are_refused(tmp_path, content, message):
    assert message in failure(write(tmp_path, content))


def test_damaged_files_are_refused(tmp_path):
    assert failure(tmp_path).startswith(f"{tmp_path} contains no reconstruction.json.")
    (tmp_path / "reconstruction.json").write_text('[{"cameras": ')
    assert "reconstruction.json cannot be read as JSON" in failure(tmp_path)
    (tmp_path / "reconstruction.json").write_text("{}")
    assert "reconstruction.json is no list of reconstructions." in failure(tmp_path)


def test_the_format_is_told_by_its_name(tmp_path):
    assert not OpenSfmConfig.detect(tmp_path).recognised
    assert OpenSfmConfig.detect(write(tmp_path)).found == "reconstruction.json"
