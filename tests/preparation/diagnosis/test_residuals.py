from pathlib import Path

import numpy as np
import pycolmap
import pytest
from support.matched_captures import MatchedCapture, matched_capture
from support.sampling import sampled

from gsfw.preparation.diagnosis.model_figures import ModelFigures
from gsfw.preparation.diagnosis.residuals import Stretch
from gsfw.preparation.mapping.mapping import map_cameras
from gsfw.preparation.mapping.mapping_rule import MappingRule


def roll(capture: MatchedCapture, degrees: float, generator: np.random.Generator) -> None:
    """Let cameras turn by so much, each about an axis of its own, while rows are read."""
    database = pycolmap.Database.open(capture.database)
    for image in capture.truth.images.values():
        turn = generator.normal(size=3)
        turn *= np.radians(degrees) / np.linalg.norm(turn)
        features = database.read_keypoints(image.image_id).copy()
        pose, camera = image.cam_from_world(), image.camera
        for feature, point in enumerate(image.points2D):
            if not point.has_point3D():
                continue
            local = pose * capture.truth.point3D(point.point3D_id).xyz
            place = camera.img_from_cam(local)
            noise = features[feature, :2] - place
            # A point is seen in the row that is read when it is there.
            for _ in range(4):
                moment = place[1] / camera.height - 0.5
                place = camera.img_from_cam(pycolmap.Rotation3d(turn * moment) * local)
            features[feature, :2] = place + noise
        database.update_keypoints(image.image_id, features)
    database.close()


def stretch(folder: Path, degrees: float, noise: float, width: int = 1024) -> Stretch:
    capture = matched_capture(folder, noise=noise, width=width)
    if degrees:
        roll(capture, degrees, np.random.default_rng(0))
    mapping = map_cameras(capture.database, folder / "models", MappingRule())
    assert mapping.sizes == (10,)
    return ModelFigures.of(pycolmap.Reconstruction(mapping.models[0])).stretch


@pytest.mark.parametrize("noise", [0.5, 1.0])
def test_noise_alone_is_not_taken_for_a_rolling_shutter(tmp_path: Path, noise: float) -> None:
    found = stretch(tmp_path, 0.0, noise)
    assert found.pixels < 0.25
    assert found.ratio < 2
    assert not found.is_suspicious
    assert found.longer_side == 1024


@pytest.mark.parametrize("noise", [0.5, 1.0])
def test_a_camera_that_turns_while_rows_are_read_is_told_from_one_that_does_not(
    tmp_path: Path, noise: float
) -> None:
    found = stretch(tmp_path, 0.2, noise)
    assert found.is_suspicious
    assert 0.8 < found.pixels < 2
    assert found.ratio > 10


@pytest.mark.parametrize("width", sampled([(240,), (320,), (640,), (4096,)], [0]))
def test_a_rolling_shutter_is_told_from_noise_at_all_sizes_of_images(
    tmp_path: Path, width: int
) -> None:
    noise = 0.4 * max(1.0, width / 1600)  # Features are found in images of up to 1600 pixels.
    for name, degrees in (("still", 0.0), ("turning", 0.4)):
        (tmp_path / name).mkdir()
        found = stretch(tmp_path / name, degrees, noise, width)
        assert found.longer_side == width
        assert found.noise == pytest.approx(noise, rel=0.2)
        assert found.is_suspicious == (degrees > 0), found


def test_errors_that_matches_of_small_images_have_in_common_are_no_rolling_shutter() -> None:
    # As those of fox, on 640 pixels: the limit that goes by the size is 0.19, on 200 it is 0.06.
    assert not Stretch(pixels=0.068, ratio=6.5, noise=0.43, longer_side=200).is_suspicious
    assert Stretch(pixels=0.25, ratio=6.5, noise=0.43, longer_side=200).is_suspicious


def test_a_model_of_too_few_points_says_nothing(tmp_path: Path) -> None:
    model = matched_capture(tmp_path, points=20).truth
    assert not ModelFigures.of(model).stretch.is_suspicious
    assert np.isnan(ModelFigures.of(model).stretch.pixels)
