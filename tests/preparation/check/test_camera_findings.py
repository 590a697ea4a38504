"""Where cameras stand."""

import numpy as np
import pytest
from support.checked_captures import ball, write_ball
from support.small_captures import HEIGHT, WIDTH, SmallCapture, write_colmap_cameras

from gsfw.preparation.finding import Weight
from gsfw.preparation.panorama_views import DIRECTIONS


def arc(count: int, degrees: float) -> np.ndarray:
    angles = np.radians(np.linspace(0, degrees, count))
    return np.stack([np.cos(angles), np.sin(angles), 0.3 + 0.1 * np.cos(9 * angles)], axis=1)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return write_ball(tmp_path_factory.mktemp("good") / "ball")


@pytest.mark.slow
def test_a_ring_around_a_thing_has_nothing_to_find(good):
    assert good.findings() == {}


def test_places_are_counted_whatever_their_order(good):
    viewpoints = good.survey().viewpoints
    assert len(viewpoints.places) == 24
    np.testing.assert_array_equal(viewpoints.places[viewpoints.place_of], np.arange(24))


def test_angles_between_views_are_those_of_the_ring(good):
    angles = good.survey().angles
    # 24 places around 360 degrees; a point is seen from all sides, as nothing hides it here.
    assert np.nanmedian(angles.nearest) == pytest.approx(15, abs=3)
    assert angles.widest > 120


def test_three_images_do_not_train(tmp_path):
    found = write_ball(tmp_path / "a", ball(count=3)).findings()
    assert found["few views"].weight is Weight.STOP  # One of the three is held out.
    assert found["few views"].found == "2 images to train on."
    assert "holdout_every=0" in found["few views"].advice


def test_ten_images_train_with_limits(tmp_path):
    assert write_ball(tmp_path / "a", ball(count=12)).findings()["few views"].weight is Weight.LIMIT


def panoramas(*views: int) -> SmallCapture:
    """The ball from five places, with views in some of ``DIRECTIONS`` from each."""
    turned = ball(count=5 * len(views))
    turned.poses[:] = [
        np.block([[rotation @ pose[:3, :3], rotation @ pose[:3, 3:]], [np.zeros((1, 3)), 1]])
        for pose in ball(count=5).poses
        for rotation in (DIRECTIONS[view].from_panorama for view in views)
    ]
    return turned


def test_views_of_a_panorama_have_one_place(tmp_path):
    found = write_ball(tmp_path / "a", panoramas(0, 1)).findings()["few views"]
    # The fifth panorama is held out.
    assert found.found == "8 images to train on from 4 places."
    assert found.advice.startswith("Take panoramas or photos from more places, a step or two apart")


def test_images_that_are_there_twice_are_no_panoramas(tmp_path):
    twice = ball(count=10)
    twice.poses[1::2] = twice.poses[::2]
    found = write_ball(tmp_path / "a", twice).findings()["few views"]
    assert found.found == "8 images to train on from 4 places."
    assert found.advice.startswith("Take more photos: 50 to 150 around a thing")


def test_a_view_of_a_panorama_may_show_nothing_that_others_show(tmp_path):
    found = write_ball(tmp_path / "a", panoramas(0, 3)).findings()
    unseen = {"cameras see no points", "few points in images", "views without neighbours"}
    assert not unseen & set(found)


def test_cameras_in_one_place_do_not_train(tmp_path):
    centers = np.tile([1.0, 0.0, 0.3], (24, 1))
    found = write_ball(tmp_path / "a", ball(centers)).findings()["no baseline"]
    assert found.weight is Weight.STOP
    assert found.found == "All 21 images were taken from one place."


@pytest.mark.slow
def test_a_small_step_to_the_side_is_a_small_baseline(tmp_path):
    for degrees, kind in ((1.0, "no baseline"), (4.0, "small baseline"), (9.0, None)):
        found = write_ball(tmp_path / str(degrees), ball(arc(24, degrees))).findings()
        assert {"no baseline", "small baseline"} & set(found) == ({kind} if kind else set())


@pytest.mark.slow
def test_cameras_on_a_line_are_told(tmp_path):
    line = np.stack([np.ones(24), np.linspace(-0.5, 0.5, 24), np.full(24, 0.3)], axis=1)
    assert "cameras on a line" in write_ball(tmp_path / "a", ball(line)).findings()
    line[::2, 2] += 0.1
    assert "cameras on a line" not in write_ball(tmp_path / "b", ball(line)).findings()


def test_views_far_apart_are_told(tmp_path):
    assert "views far apart" in write_ball(tmp_path / "a", ball(count=7)).findings()


def test_an_open_side_is_a_note(tmp_path):
    found = write_ball(tmp_path / "a", ball(arc(24, 150.0))).findings()["open side"]
    assert found.weight is Weight.NOTE
    assert 200 < int(found.found.split()[5]) < 225


def test_held_out_views_far_from_the_others_are_told(tmp_path):
    centers = arc(24, 60.0)
    centers[0] = [-0.2, 1.0, 0.3]  # Held out: the first by name, with every 8th.
    centers[8] = [-0.3, -1.0, 0.3]
    centers[16] = [0.3, -1.0, 0.3]
    assert "held-out views far away" in write_ball(tmp_path / "a", ball(centers)).findings()


@pytest.mark.slow
def test_a_focal_length_that_no_camera_has_is_told(tmp_path):
    for focal, odd in ((400.0, True), (70.0, False), (15.0, True)):
        params = (focal, focal, 32.0, 24.0)
        written = write_ball(tmp_path / str(focal), ball(points=2000), params=params)
        found = written.findings(1)
        assert ("field of view" in found) is odd
        assert not odd or found["field of view"].weight is Weight.LIMIT


def test_pixels_that_are_not_square_are_told(tmp_path):
    params = (70.0, 90.0, 32.0, 24.0)
    found = write_ball(tmp_path / "a", params=params).findings(1)
    assert found["pixels not square"].found.startswith("Pixels of 24 of 24 images are 0.778")


def test_a_focal_length_for_each_image_is_told(tmp_path):
    for spread, odd in ((1.0, True), (0.0, False)):
        capture = ball()
        written = write_ball(tmp_path / str(spread), capture)
        cameras = {
            number + 1: ("PINHOLE", WIDTH, HEIGHT, (focal, focal, 32.0, 24.0))
            for number, focal in enumerate(70 + spread * np.arange(24))
        }
        model = written.folder / "sparse" / "0"
        write_colmap_cameras(model, capture, cameras, list(cameras))
        assert ("focal lengths differ" in written.findings(1)) is odd
