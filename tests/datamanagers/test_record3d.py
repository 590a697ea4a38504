"""The ``record3d`` format."""

import pytest
import torch
from support.captures.record3d import write
from support.refusals import failure_of
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, builder_of, projection_error, ring

from gsfw.core.datamanager import Split
from gsfw.datamanagers.record3d import Record3dConfig
from gsfw.preparation.check.leftovers import Leftovers


def expected(views=4):
    capture = ring(views)
    capture.names[:] = [f"{number}.jpg" for number in range(views)]
    return capture


build = builder_of(Record3dConfig)
failure = failure_of(build)


def test_points_fall_where_they_should(tmp_path):
    data = build(write(tmp_path))
    assert projection_error(data, expected()) < 0.01
    assert data.scene.up == "y"
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape == (1, HEIGHT, WIDTH, 3)
    unpacked = write(tmp_path / "r3d", file="metadata", images="rgbd")
    assert projection_error(build(unpacked), expected()) < 0.01


def test_the_lens_of_each_image_is_preferred(tmp_path):
    own = [[*FOCAL, *CENTER]] * 4
    data = build(write(tmp_path, K=[1.0] * 9, perFrameIntrinsicCoeffs=own))
    assert projection_error(data, expected()) < 0.01


def test_long_recordings_are_thinned_evenly(tmp_path):
    data = build(write(tmp_path, views=11), {"max_images": 6})
    used = {*data.views(Split.TRAIN).names, *data.views(Split.EVAL).names}
    assert used == {f"{number}.jpg" for number in (0, 2, 4, 6, 8, 10)}
    assert "6 of 11 images are used (datamanager.max_images=N: more)" in data.notes()
    assert Leftovers.of(data).photos == ()


def test_missing_images_are_noted(tmp_path):
    write(tmp_path)
    (tmp_path / "rgb/1.jpg").unlink()
    assert "1 of 4 images are not on disk and are left out: 1" in build(tmp_path).notes()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"poses": None}, "metadata.json: poses is missing; expected a list of poses."),
        ({"poses": [[0.0] * 6] * 4}, "image 0: pose: expected 7 finite numbers, found [0.0, 0.0"),
        ({"poses": [[1, 1, 0, 1, 0, 0, 0]] * 4}, "image 0: the pose (transform_matrix) is not"),
        ({"K": None}, "image 0: K is missing; expected 9 finite numbers."),
        ({"w": "wide"}, "image 0: w: expected one finite number, found 'wide'."),
        ({"K": [-1.0] * 9}, "is no camera."),
    ],
)
def test_malformed_cameras_are_refused(tmp_path, settings, message):
    assert message in failure(write(tmp_path, **settings))


def test_the_format_is_told_by_its_files_and_is_no_other(tmp_path):
    assert "contains no metadata.json with rgb/" in failure(tmp_path)
    assert Record3dConfig.detect(write(tmp_path)).found == "Record3D's metadata.json"
    (tmp_path / "dataset.json").write_text("{}")
    assert not Record3dConfig.detect(tmp_path).recognised
