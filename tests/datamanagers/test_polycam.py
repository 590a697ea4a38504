"""The ``polycam`` format."""

import numpy as np
import pytest
import torch
from PIL import Image
from support.captures.polycam import write
from support.refusals import failure_of
from support.small_captures import HEIGHT, WIDTH, builder_of, projection_error, ring

from gsfw.core.datamanager import Split
from gsfw.datamanagers.polycam import PolycamConfig
from gsfw.preparation.check.leftovers import Leftovers

build = builder_of(PolycamConfig)
failure = failure_of(build)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, ring()) < 0.01
    assert projection_error(build(tmp_path / "keyframes"), ring()) < 0.01
    assert projection_error(build(tmp_path, downscale=2.0), ring(), 0.5) < 0.01
    assert data.scene.up == "y"
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape == (1, HEIGHT, WIDTH, 3)


def test_corrected_cameras_are_preferred_with_their_images(tmp_path):
    write(tmp_path)
    write(tmp_path, "corrected_", views=3)
    assert projection_error(build(tmp_path), ring(3)) < 0.01
    assert build(tmp_path).notes()[0] == f"{tmp_path}/keyframes/corrected_cameras: 3 cameras"
    assert projection_error(build(tmp_path, {"corrected": False}), ring()) < 0.01


def test_blurred_images_are_left_out_when_asked_for(tmp_path):
    data = build(write(tmp_path), {"min_blur_score": 65.0})
    assert data.views(Split.TRAIN).names == ("view_002.png", "view_003.png")
    assert "2 images score below 65 and are left out" in data.notes()
    assert Leftovers.of(data).photos == ()
    assert failure(tmp_path, {"min_blur_score": 99.0}).startswith(
        "datamanager.min_blur_score=99: all 4 images score lower."
    )


def test_what_is_not_used_is_noted(tmp_path):
    write(tmp_path)
    (tmp_path / "keyframes/depth").mkdir()
    (tmp_path / "mesh_info.json").write_text("{}")
    assert (
        "not used: keyframes/depth (datamanager.maps=depth:keyframes/depth loads it), "
        "mesh_info.json (where Polycam's mesh lies)"
    ) in build(tmp_path).notes()


def test_missing_images_are_noted(tmp_path):
    write(tmp_path)
    (tmp_path / "keyframes/images/view_001.png").unlink()
    assert "1 of 4 images are not on disk and are left out: view_001" in build(tmp_path).notes()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fx": None}, "view_000.json: fx is missing; expected one finite number."),
        ({"cy": "middle"}, "view_000.json: cy: expected one finite number, found 'middle'."),
        ({"t_03": True}, "view_000.json: t_03: expected one finite number, found True."),
        ({"t_00": 3.0}, "view_000.json: the pose (transform_matrix) is not rigid"),
        ({"fy": -1.0}, "is no camera."),
        ({"width": 99}, "view_000.json describes 99x48."),
    ],
)
def test_malformed_cameras_are_refused(tmp_path, settings, message):
    assert message in failure(write(tmp_path, **settings))


def test_damaged_or_missing_files_are_refused(tmp_path):
    assert "contains no keyframes/ with images/ and cameras/" in failure(tmp_path)
    write(tmp_path)
    file = tmp_path / "keyframes/cameras/view_000.json"
    file.write_text("[1]")
    assert f"{file}: expected an object, found [1]." in failure(tmp_path)
    file.write_text('{"fx": ')
    assert f"{file} cannot be read as JSON" in failure(tmp_path)


def test_the_format_is_told_by_its_folders(tmp_path):
    assert not PolycamConfig.detect(tmp_path).recognised
    write(tmp_path)
    assert PolycamConfig.detect(tmp_path).found == "Polycam's keyframes/cameras/"
    assert PolycamConfig.detect(tmp_path / "keyframes").found == "Polycam's cameras/"


def test_depth_is_loaded_as_a_map(tmp_path):
    write(tmp_path)
    folder = tmp_path / "keyframes/depth"
    folder.mkdir()
    for image in (tmp_path / "keyframes/images").iterdir():
        Image.fromarray(np.full((12, 16), 2500, np.uint16)).save(folder / f"{image.stem}.png")
    data = build(tmp_path, {"maps": ("depth:keyframes/depth",)})
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    scale = data.scene.world_from_scene.scale
    assert np.allclose(scale * batch.maps["depth"].values, 2.5)
    assert not any("not used" in note for note in data.notes())
