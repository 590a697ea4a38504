"""The ``reality-capture`` format."""

import pytest
import torch
from support.captures.reality_capture import DISTORTION, HEADER, INTRINSICS, row, write
from support.foreign_cameras import brown, pixel_error, undistorted_error
from support.refusals import failure_of
from support.small_captures import FOCAL, HEIGHT, WIDTH, builder_of, projection_error, ring, square

from gsfw.core.datamanager import Split
from gsfw.datamanagers.reality_capture import RealityCaptureConfig, _pose

build = builder_of(RealityCaptureConfig)
failure = failure_of(build)


NEW_HEADER = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2"


@pytest.mark.parametrize(
    "header", [HEADER, NEW_HEADER, f"#cameras 4\n{HEADER}", HEADER[1:].upper()]
)
def test_points_fall_where_they_should(tmp_path, header):
    data = build(write(tmp_path, header=header))
    assert projection_error(data, square(ring())) < 0.01
    assert projection_error(build(tmp_path / "export.csv"), square(ring())) < 0.01
    assert projection_error(build(tmp_path, downscale=2.0), square(ring()), 0.5) < 0.01
    assert data.scene.up == "z"
    assert data.notes()[0] == f"{tmp_path}/export.csv: 4 cameras"


def test_images_may_lie_beside_the_file(tmp_path):
    assert projection_error(build(write(tmp_path, images=".")), square(ring())) < 0.01


def test_angles_are_those_of_a_drone():
    """A camera that looks straight down has north above; rolled, its right side goes down."""

    def axes(heading, pitch, roll):
        angles = {"heading": heading, "pitch": pitch, "roll": roll}
        values = {"x": 0.0, "y": 0.0, "alt": 0.0} | {k: float(v) for k, v in angles.items()}
        return _pose(values, "here")[:3, :3]

    down, north = torch.tensor([0.0, 0, -1]).double(), torch.tensor([0.0, 1, 0]).double()
    east = torch.tensor([1.0, 0, 0]).double()
    for found, wanted in (
        (axes(0, 0, 0), (east, -north, down)),
        (axes(0, 90, 0), (east, down, north)),
        (axes(90, 90, 0), (-north, down, east)),
        (axes(0, 0, 90), (down, -north, -east)),
    ):
        torch.testing.assert_close(found, torch.stack(wanted))


def test_distorted_cameras_see_points_where_the_formula_says(tmp_path):
    """Brown4 with tangential terms, t1 on r^2 + 2 x^2; pixels from the corner."""
    capture = ring()
    rows = [row(capture, view, distortion=DISTORTION) for view in range(4)]
    data = build(write(tmp_path, rows))

    def formula(x, y):
        x, y = brown(x, y, DISTORTION[:4], DISTORTION[4:])
        scale, (f, px, py) = max(WIDTH, HEIGHT), INTRINSICS
        return (f / 36 * x + px) * scale + WIDTH / 2, (f / 36 * y + py) * scale + HEIGHT / 2

    assert pixel_error(data, capture, formula) < 0.01
    assert undistorted_error(data, capture) < 0.01
    (batch,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    assert batch.images.shape[1:3] == (batch.cameras.height, batch.cameras.width)


def test_columns_after_the_focal_length_may_be_missing(tmp_path):
    rows = [",".join(row(ring(), view).split(",")[:8]) for view in range(4)]
    data = build(write(tmp_path, rows, "#name,x,y,alt,heading,pitch,roll,f"))
    lens = data.recording.frames[0].lens
    assert (lens.fx, lens.cx, lens.cy) == (pytest.approx(FOCAL[0]), WIDTH / 2, HEIGHT / 2)
    assert lens.is_pinhole


def test_images_of_one_lens_have_one_camera(tmp_path):
    rows = [row(ring(), 0), row(ring(), 1), row(ring(), 2, intrinsics=(40, 0, 0)), row(ring(), 3)]
    data = build(write(tmp_path, rows))
    assert [frame.camera for frame in data.recording.frames] == [0, 0, 1, 0]


def test_missing_images_are_noted(tmp_path):
    rows = [row(ring(), 0), row(ring(), 1, "gone.png"), *(row(ring(), view) for view in (2, 3))]
    notes = build(write(tmp_path, rows)).notes()
    assert "1 of 4 images are not on disk and are left out: gone.png" in notes


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "export.csv contains no cameras."),
        (["view_000.png,1,2,3"], "export.csv: line 2 has 4 of 16 columns."),
        (["view_000.png," + ",".join("1" * 6) + ",wide" + ",0" * 8],
         "line 2 (view_000.png): f is 'wide'; expected a number."),
        (["view_000.png," + ",".join("1" * 6) + ",-35" + ",0" * 8], "is no camera."),
        (["a" * 200_000], "export.csv: line 2 is no CSV: "),
        (["view_000.png,nan," + ",".join("1" * 6) + ",0" * 8], "x is 'nan'; expected a number."),
    ],
)  # fmt: skip
def test_malformed_files_are_refused(tmp_path, rows, message):
    assert message in failure(write(tmp_path, rows))


def test_the_format_is_told_by_the_first_line(tmp_path):
    (tmp_path / "flight.csv").write_text("name,x,y,z\na.jpg,1,2,3\n")
    (tmp_path / "empty.csv").touch()
    assert not RealityCaptureConfig.detect(tmp_path).recognised
    assert "first line is #name,x,y,alt,heading,pitch,roll,f,...; found none." in failure(tmp_path)
    write(tmp_path)
    assert RealityCaptureConfig.detect(tmp_path).found == "RealityCapture's export.csv"
