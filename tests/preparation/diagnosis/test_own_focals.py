"""Own focal lengths, on models whose images were taken with known ones."""

from typing import Any

import numpy as np
import pycolmap
import pytest
from support.checked_captures import looking_at

from gsfw.preparation.diagnosis import own_focals as module
from gsfw.preparation.diagnosis.own_focals import own_focals

FOCAL, WIDTH, HEIGHT = 400.0, 640, 480
NOISE = 0.3
VIEWS = 8


def model_of(
    focals: dict[int, float], thickness: float = 1.0, own: bool = False, swing: float = 0.0
) -> Any:
    """A model of one focal length for all, whose other images have been moved towards the points.

    Args:
        focals: with which images were taken, by their numbers; ``FOCAL`` for the others.
        thickness: of the points across a plane.
        own: whether each image has a camera of its own, with the right focal length.
        swing: degrees by which cameras turn, each about another axis, while rows are read.
    """
    generator = np.random.default_rng(0)
    points = generator.uniform(-1, 1, (150, 3)) * (1, 1, thickness)
    model = pycolmap.Reconstruction()
    tracks = [pycolmap.Track() for _ in points]
    for number in range(1, VIEWS + 1):
        taken = focals.get(number, FOCAL)
        angle = np.radians(15 * number)
        center = np.array([4 * np.cos(angle), 4 * np.sin(angle), 2 + number % 2])
        pose = looking_at(center, 0.2 * generator.normal(size=3))
        local = points @ pose[:3, :3].T + pose[:3, 3]
        places = taken * local[:, :2] / local[:, 2:] + (WIDTH / 2, HEIGHT / 2)
        axis = generator.normal(size=3)
        axis *= np.radians(swing) / np.linalg.norm(axis)
        for _ in range(4 if swing else 0):
            moments = places[:, 1:] / HEIGHT - 0.5
            seen = local + np.cross(axis * moments, local)
            places = taken * seen[:, :2] / seen[:, 2:] + (WIDTH / 2, HEIGHT / 2)
        places += generator.normal(0, NOISE, places.shape)
        focal = taken if own else FOCAL
        pose[2, 3] *= focal / taken
        camera = number if own else 1
        if not model.exists_camera(camera):
            intrinsics = [focal, focal, WIDTH / 2, HEIGHT / 2, 0, 0, 0, 0]
            model.add_camera_with_trivial_rig(
                pycolmap.Camera(
                    camera_id=camera,
                    model="OPENCV",
                    width=WIDTH,
                    height=HEIGHT,
                    params=intrinsics,
                )
            )
        image = pycolmap.Image(f"{number}.jpg", places, camera, number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
        for place, track in enumerate(tracks):
            track.add_element(number, place)
    for point, track in zip(points, tracks, strict=True):
        model.add_point3D(point, track)
    return model


def test_images_of_another_focal_length_are_found_with_it() -> None:
    found = own_focals(model_of({3: 700.0, 6: 700.0}))
    assert list(found) == ["3.jpg", "6.jpg"]
    assert list(found.values()) == pytest.approx([700.0, 700.0], rel=0.03)


@pytest.mark.parametrize("thickness", [1.0, 0.0])
def test_one_focal_length_for_all_is_enough_for_one_lens(thickness: float) -> None:
    assert own_focals(model_of({}, thickness)) == {}


@pytest.mark.parametrize("thickness", [1.0, 0.1])
def test_images_that_a_rolling_shutter_bends_have_no_other_focal_length(thickness: float) -> None:
    assert own_focals(model_of({}, thickness, swing=5.0)) == {}


def test_places_that_a_lens_cannot_have_shown_do_not_count() -> None:
    model = model_of({3: 700.0, 6: 700.0})
    lens = model.camera(1)
    lens.params = [*lens.params[:4], -0.005, 0.0, 0.0, 0.0]
    model.image(1).points2D[5].xy = far = np.array([1e6, 1e6])
    assert lens.cam_from_img(far) is None
    assert list(own_focals(model)) == ["3.jpg", "6.jpg"]


def test_cameras_of_single_images_have_their_own_already() -> None:
    assert own_focals(model_of({3: 700.0}, own=True)) == {}


def test_thinned_points_leave_each_image_enough_to_tell_its_focal_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # 10 points for each image would give 4 of 8 another focal length.
    monkeypatch.setattr(module, "MOST_OBSERVATIONS", 80)
    assert own_focals(model_of({}, thickness=0.1)) == {}
    assert list(own_focals(model_of({3: 700.0, 6: 700.0}))) == ["3.jpg", "6.jpg"]


def test_an_image_that_sees_few_points_has_no_other_focal_length() -> None:
    model = model_of({})
    for place in (*range(40), *range(44, len(model.points3D))):
        model.delete_observation(4, place)
    assert model.image(4).num_points3D == 4
    assert own_focals(model) == {}


def test_points_behind_a_camera_are_no_error_that_another_focal_length_explains() -> None:
    # Noise is most of the error of the first image.
    model, generator = model_of({1: 500.0}), np.random.default_rng(1)
    for feature in model.image(1).points2D:
        feature.xy += generator.normal(0, 4, 2)
    assert own_focals(model) == {}
    behind = 1.1 * model.image(1).projection_center()
    for place in range(10):
        point = model.point3D(place + 1)
        point.xyz = behind + np.array([0, 0, 0.02 * place])
        for number in range(2, VIEWS + 1):
            local = model.image(number).cam_from_world() * point.xyz
            if local[2] > 0:
                model.image(number).points2D[place].xy = model.camera(1).img_from_cam(local)
            else:
                model.delete_observation(number, place)
    assert own_focals(model) == {}
