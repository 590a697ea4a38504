"""What intrinsics show."""

import numpy as np
from support.checked_captures import ball, write_ball
from support.small_captures import HEIGHT, WIDTH, write_colmap_cameras

from gsfw.preparation.finding import Weight


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
    assert found["pixels not square"].found.startswith("Pixels of 24 of 24 pictures are 0.778")


def test_a_focal_length_for_each_picture_is_told(tmp_path):
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
