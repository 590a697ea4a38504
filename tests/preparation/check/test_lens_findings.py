"""Focal lengths of one lens, against each other and against EXIF."""

import numpy as np
from PIL import Image
from PIL.ExifTags import IFD, Base
from support.checked_captures import ball, write_ball
from support.small_captures import HEIGHT, WIDTH, write_colmap_cameras


def write_focals(folder, fx, fy=None, exif_focal: float | None = None, capture=None):
    """A capture with a camera for each image; the EXIF tag has mm on film."""
    capture = capture or ball(count=len(fx))
    written = write_ball(folder, capture)
    fy = fx if fy is None else fy
    cameras = {
        number + 1: ("PINHOLE", WIDTH, HEIGHT, (float(x), float(y), 32.0, 24.0))
        for number, (x, y) in enumerate(zip(fx, fy, strict=True))
    }
    write_colmap_cameras(written.folder / "sparse" / "0", capture, cameras, list(cameras))
    for name in capture.names:
        if exif_focal is not None:
            path = written.folder / "images" / name
            image, exif = Image.open(path), Image.Exif()
            exif[Base.Model] = "P7"
            exif[IFD.Exif] = {Base.FocalLengthIn35mmFilm: round(exif_focal)}
            image.save(path, exif=exif)
    return written


def test_focal_lengths_of_one_camera_that_differ_are_told_with_the_remedy(tmp_path):
    spread = np.linspace(50, 104, 24)  # As 905 to 1886 pixels of one camera.
    found = write_focals(tmp_path / "a", spread, exif_focal=40).findings(1)
    differ = found["focal lengths differ"]
    assert "P7 took at one setting by EXIF" in differ.found
    assert "50 to 104 pixels" in differ.found
    assert "gsfw prepare IMAGES out=DIR cameras=one" in differ.advice
    assert "pixels not square" not in found


def test_a_few_lenses_without_exif_may_differ(tmp_path):
    two = np.where(np.arange(24) % 2, 70.0, 100.0)
    assert "focal lengths differ" not in write_focals(tmp_path / "a", two).findings(1)


def test_pixels_of_a_failed_calibration_are_not_called_stretched_images(tmp_path):
    focals = np.full(24, 70.0)
    found = write_focals(tmp_path / "a", focals, focals * np.linspace(1.06, 1.4, 24)).findings(1)
    odd = found["pixels not square"]
    assert "each image's otherwise" in odd.found
    assert "calibration" in odd.why
    assert "stretched" not in odd.found + odd.why + odd.advice


def test_parallel_views_with_pixels_that_are_not_square_need_their_focal_length(tmp_path):
    flight = ball(count=24)
    for pose, side in zip(flight.poses, np.linspace(-0.3, 0.3, 24), strict=True):
        pose[:] = flight.poses[0]
        pose[0, 3] += side
    focals = np.full(24, 70.0)
    odd = write_focals(tmp_path / "a", focals, 2 * focals, capture=flight).findings(1)
    assert "focal=PIXELS refine_focal=false" in odd["pixels not square"].advice
    odd = write_focals(tmp_path / "b", focals, 2 * focals).findings(1)
    assert "camera_model=SIMPLE_RADIAL" in odd["pixels not square"].advice


def test_two_or_three_images_tell_nothing_of_a_lens(tmp_path):
    for count, told in ((3, False), (4, True)):
        focals = np.linspace(60.0, 90.0, count)
        found = write_focals(tmp_path / str(count), focals, 1.5 * focals, 40).findings(1)
        assert ("pixels not square" in found) is told
        assert ("focal lengths differ" in found) is told


def test_a_focal_length_far_from_exif_is_a_note(tmp_path):
    for focal, odd in ((70.0, False), (110.0, True)):
        written = write_focals(tmp_path / str(focal), np.full(24, focal), exif_focal=40)
        assert ("focal length against EXIF" in written.findings(1)) is odd
