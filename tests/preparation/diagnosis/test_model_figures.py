import json
import math
from typing import Any

import numpy as np
import pycolmap
import pytest

from gsfw.core.files.json_text import json_text
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.diagnosis.model_figures import ModelFigures, widest_angles
from gsfw.preparation.mapping.observations import Observations

FOCAL = 400.0
WIDTH, HEIGHT = 640, 480


def reconstruction(
    centers: list[tuple[float, float, float]],
    points: list[tuple[tuple[float, float, float], tuple[int, ...]]],
    turns: tuple[float, ...] = (),
    offsets: dict[int, tuple[float, float]] | None = None,
) -> Any:
    """A model of images named 1.jpg and so on that look along z.

    Args:
        centers: of the images, which are counted from 1.
        points: position, and the images that see it.
        turns: degrees about the y axis, where not 0.
        offsets: pixels by which all points of an image are seen off their places.
    """
    camera = pycolmap.Camera(
        camera_id=1,
        model="SIMPLE_RADIAL",
        width=WIDTH,
        height=HEIGHT,
        params=[FOCAL, WIDTH / 2, HEIGHT / 2, 0.1],
    )
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    tracks: list[list[tuple[int, int]]] = [[] for _ in points]
    for number, center in enumerate(centers, 1):
        degrees = turns[number - 1] if turns else 0.0
        rotation = pycolmap.Rotation3d(np.array([0.0, math.radians(degrees), 0.0]))
        pose = pycolmap.Rigid3d(rotation, -(rotation * np.array(center)))
        offset = np.array((offsets or {}).get(number, (0.0, 0.0)))
        places = []
        for track, (position, images) in zip(tracks, points, strict=True):
            if number in images:
                track.append((number, len(places)))
                places.append(camera.img_from_cam(pose * np.array(position)) + offset)
        image = pycolmap.Image(f"{number}.jpg", np.array(places).reshape(-1, 2), 1, number)
        model.add_image_with_trivial_frame(image, pose)
    for track, (position, _) in zip(tracks, points, strict=True):
        elements = [pycolmap.TrackElement(*one) for one in track]
        model.add_point3D(np.array(position), pycolmap.Track(elements))
    return model


ROW = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)]


def degrees_between(distance: float, depth: float) -> float:
    """Seen from the middle of the line between two cameras."""
    return math.degrees(2 * math.atan2(distance / 2, depth))


def test_images_points_and_tracks_are_counted() -> None:
    model = reconstruction(
        ROW, [((1, 0, 10), (1, 2, 3)), ((1, 1, 10), (1, 3)), ((1, 2, 8), (2, 3))]
    )
    figures = ModelFigures.of(model)
    assert (figures.registered, figures.points, figures.observations) == (3, 3, 7)
    assert figures.seen == {"1.jpg": 2, "2.jpg": 2, "3.jpg": 3}
    assert figures.tracks.mean_length == pytest.approx(7 / 3)
    assert figures.tracks.share_of_pairs == pytest.approx(2 / 3)


def test_errors_are_in_pixels_over_observations_and_by_image() -> None:
    points = [((1.0, y, 10.0), (1, 2, 3)) for y in (-1.0, 0.0, 1.0)] + [((1.0, 2.0, 9.0), (1, 2))]
    figures = ModelFigures.of(reconstruction(ROW, points, offsets={2: (3.0, 4.0)}))
    assert figures.errors == pytest.approx({"1.jpg": 0.0, "2.jpg": 5.0, "3.jpg": 0.0}, abs=1e-6)
    assert figures.error == pytest.approx(4 * 5.0 / 11)


def test_errors_agree_with_those_of_colmap() -> None:
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.7
    noise.rig_from_world_rotation_stddev = 0.01
    model = pycolmap.synthesize_dataset(options)
    pycolmap.synthesize_noise(noise, model)
    # All points are seen by all images, so that both means are the same.
    expected = model.compute_mean_reprojection_error()
    assert ModelFigures.of(model).error == pytest.approx(expected, rel=1e-9)


def test_the_widest_angle_of_each_track_counts() -> None:
    points = [
        ((1.0, 0.0, 10.0), (1, 2, 3)),
        ((1.0, 0.0, 10.0), (1, 3)),
        ((0.5, 0.0, 5.0), (1, 2)),
        ((0.5, 0.0, 50.0), (1, 2)),
    ]
    model = reconstruction(ROW, points)
    figures = ModelFigures.of(model).tracks
    wide, middle, narrow = (degrees_between(*one) for one in ((2, 10), (1, 5), (1, 50)))
    assert wide == pytest.approx(11.42, abs=0.01)
    assert narrow == pytest.approx(1.15, abs=0.01)
    seen = Observations.of(model)
    centers = np.array(ROW)
    angles = dict(zip(model.points3D, widest_angles(seen, centers), strict=True))
    assert [angles[number] for number in (1, 2, 3, 4)] == pytest.approx(
        [wide, wide, middle, narrow]
    )
    assert figures.median_degrees == pytest.approx(wide)
    assert figures.low_degrees == pytest.approx(narrow + 0.3 * (middle - narrow))
    assert figures.share_too_narrow == 0.25
    assert figures.share_narrow == 0.25


def test_angles_do_not_depend_on_how_many_are_computed_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    options.track_length = 4
    model = pycolmap.synthesize_dataset(options)
    seen = Observations.of(model)
    centers = np.array([model.image(int(n)).projection_center() for n in seen.image_ids])
    whole = widest_angles(seen, centers)
    monkeypatch.setattr("gsfw.preparation.diagnosis.model_figures.AT_ONCE", 100)
    assert (widest_angles(seen, centers) == whole).all()


def test_baselines_are_measured_to_the_nearest_camera() -> None:
    centers = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (5.0, 0.0, 0.0)]
    points = [((x, 0.0, 10.0), (1, 2, 3)) for x in (0.0, 1.0, 2.0)]
    figures = ModelFigures.of(reconstruction(centers, points)).baselines
    # Distances are 1, 1 and 4, and all depths 10.
    assert figures.to_depth == pytest.approx(0.1)
    assert figures.degrees == pytest.approx(0, abs=1e-5)
    assert figures.spread == pytest.approx(math.sqrt((4 + 1 + 9) / 3))
    assert figures.cloud_to_spread == pytest.approx(1.0 / figures.spread)


def test_directions_are_compared_with_the_nearest_camera() -> None:
    points = [((1.0, 0.0, 10.0), (1, 2, 3))]
    figures = ModelFigures.of(reconstruction(ROW, points, turns=(0.0, 8.0, 18.0))).baselines
    assert figures.degrees == pytest.approx(8.0)


def test_the_spread_of_views_is_measured_from_their_mean() -> None:
    points = [((1.0, 0.0, 10.0), (1, 2, 3))]
    figures = ModelFigures.of(reconstruction(ROW, points, turns=(-6.0, 0.0, 6.0))).baselines
    assert figures.view_spread == pytest.approx(6.0)


def test_cameras_are_compared_with_what_was_assumed() -> None:
    group = CameraGroup(1, "SIMPLE_RADIAL", WIDTH, HEIGHT, 500.0, "EXIF", ("1.jpg",))
    model = reconstruction(ROW, [((1, 0, 10), (1, 2, 3))])
    (camera,) = ModelFigures.of(model, [group]).cameras
    assert (camera.number, camera.model, camera.images) == (1, "SIMPLE_RADIAL", 3)
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert (camera.focal, camera.first_focal, camera.focal_origin) == (400.0, 500.0, "EXIF")
    assert camera.focal_ratio == pytest.approx(0.8)
    assert camera.view_degrees == pytest.approx(math.degrees(2 * math.atan(0.8)))
    assert camera.principal_point == (320.0, 240.0)
    assert camera.distortion == {"k": 0.1}
    (unknown,) = ModelFigures.of(model).cameras
    assert (unknown.first_focal, unknown.focal_origin, unknown.focal_ratio) == (None, "", None)


def test_the_field_of_view_of_an_upright_camera_is_across_its_width() -> None:
    model = reconstruction(ROW, [((1, 0, 10), (1, 2, 3))])
    model.camera(1).width, model.camera(1).height = HEIGHT, WIDTH
    (camera,) = ModelFigures.of(model).cameras
    assert camera.view_degrees == pytest.approx(math.degrees(2 * math.atan(0.6)))


@pytest.mark.parametrize("centers", [[], [(0.0, 0.0, 0.0)], ROW])
def test_a_model_without_points_has_figures_all_the_same(
    centers: list[tuple[float, float, float]],
) -> None:
    figures = ModelFigures.of(reconstruction(centers, []))
    assert (figures.registered, figures.points) == (len(centers), 0)
    assert math.isnan(figures.error)
    assert math.isnan(figures.tracks.median_degrees)
    assert figures.errors == {}
    assert json.loads(json_text(figures.document()))["registered"] == len(centers)


def test_two_cameras_in_one_place_are_neighbours_of_each_other() -> None:
    centers = [(0.0, 0.0, 0.0)] * 2 + [(3.0, 0.0, 0.0)]
    points = [((1.0, 0.0, 10.0), (1, 2, 3))]
    figures = ModelFigures.of(reconstruction(centers, points, turns=(0.0, 6.0, 6.0)))
    assert figures.baselines.degrees == pytest.approx(6.0)
    assert figures.baselines.to_depth == 0.0
