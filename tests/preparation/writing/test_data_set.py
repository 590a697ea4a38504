"""Data sets of estimated cameras: models, points and tracks that fit the images."""

import numpy as np
import pycolmap
import pytest
import torch
from PIL import Image
from support.distorted_images import HEIGHT, WIDTH, lens
from support.estimated_cameras import VIEWS, estimate, frames, images, loaded, photos

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.reader import read_model
from gsfw.preparation.writing.data_set import write_data_set
from gsfw.preparation.writing.image_output import OutputRule

KEEP = OutputRule("keep")
MODELS = ("SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE")


def check_tracks(model: pycolmap.Reconstruction) -> None:
    """Check that images and tracks name each other."""
    assert model.is_valid()
    named = 0
    for number, point in model.points3D.items():
        assert point.track.length() >= 2
        for element in point.track.elements:
            seen = model.images[element.image_id].points2D[element.point2D_idx]
            assert seen.point3D_id == number
            named += 1
    has_point = [p.has_point3D() for image in model.images.values() for p in image.points2D]
    assert sum(has_point) == named


@pytest.mark.parametrize("model", MODELS)
def test_undistorted_data_sets_are_what_training_makes_of_distorted_ones(tmp_path, model):
    taken = photos(tmp_path / "photos")
    estimated = estimate(lens(model))
    write_data_set(estimated, taken, tmp_path / "pinhole", OutputRule())
    write_data_set(estimated, taken, tmp_path / "keep", KEEP)
    flat, bent = loaded(tmp_path / "pinhole"), loaded(tmp_path / "keep")
    assert {frame.lens.model for frame in frames(flat)} == {"PINHOLE"}
    assert {frame.lens.model for frame in frames(bent)} == {model}
    cameras = zip(flat.views(Split.TRAIN).cameras, bent.views(Split.TRAIN).cameras, strict=True)
    for one, other in cameras:
        assert torch.allclose(one.world_to_camera, other.world_to_camera, atol=1e-6)
        assert torch.allclose(one.intrinsics, other.intrinsics, atol=1e-4)
    for one, other in zip(images(flat), images(bent), strict=True):
        assert torch.equal(one, other)


@pytest.mark.parametrize("model", MODELS)
def test_points_land_on_their_moved_observations(tmp_path, model):
    taken = photos(tmp_path / "photos")
    found = write_data_set(estimate(lens(model)), taken, tmp_path, OutputRule())
    written = pycolmap.Reconstruction(tmp_path / "sparse/0")
    check_tracks(written)
    assert (found.images, found.points) == (VIEWS, written.num_points3D())
    seen = 0
    for image in written.images.values():
        for observation in image.get_observation_points2D():
            place = image.project_point(written.points3D[observation.point3D_id].xyz)
            assert np.abs(place - observation.xy).max() < 0.01
            seen += 1
    assert seen > 40
    assert all(point.error < 0.01 for point in written.points3D.values())


def test_what_falls_outside_leaves_the_tracks(tmp_path):
    estimated = estimate(lens("OPENCV_FISHEYE"))
    corners = [
        pycolmap.TrackElement(view, estimated.images[view].num_points2D() - 1) for view in (1, 2)
    ]
    lost = estimated.add_point3D([0.0, 0.0, 0.0], pycolmap.Track(corners))
    taken = photos(tmp_path / "photos")
    found = write_data_set(estimated, taken, tmp_path / "out", OutputRule())
    written = pycolmap.Reconstruction(tmp_path / "out/sparse/0")
    check_tracks(written)
    assert lost not in written.points3D
    assert set(written.points3D) < set(estimated.points3D)
    for image in written.images.values():
        places = np.array([p.xy for p in image.points2D])
        assert (places >= 0).all()
        assert (places <= found.sizes[0]).all()
    gone = estimated.num_points3D() - written.num_points3D()
    assert found.notes == (
        f"{gone} points, which fewer than two undistorted images show, are left out",
    )


@pytest.mark.parametrize("rule", [OutputRule(), KEEP], ids=["pinhole", "keep"])
def test_points_have_the_mean_colour_of_where_they_were_seen(tmp_path, rule):
    estimated = estimate(lens("OPENCV"))
    write_data_set(estimated, photos(tmp_path / "photos"), tmp_path, rule)
    written = pycolmap.Reconstruction(tmp_path / "sparse/0")
    for number, point in written.points3D.items():
        colors = []
        for element in estimated.points3D[number].track.elements:
            x, y = estimated.images[element.image_id].points2D[element.point2D_idx].xy - 0.5
            last = (WIDTH - 1, HEIGHT - 1)
            colors.append([*np.clip([x, y], 0, last), 50 * (element.image_id - 1)])
        assert np.abs(point.color - np.mean(colors, axis=0)).max() <= 0.5 + 1e-9


def test_all_readers_find_the_model(tmp_path):
    write_data_set(estimate(lens("OPENCV")), photos(tmp_path / "p"), tmp_path, KEEP)
    ours = read_model(tmp_path / "sparse/0")
    theirs = pycolmap.Reconstruction(tmp_path / "sparse/0")
    assert [image.name for image in ours.images] == [f"view_{view}.png" for view in range(VIEWS)]
    assert len(ours.points) == theirs.num_points3D() == 20
    assert sorted(path.name for path in (tmp_path / "sparse/0").iterdir()) == [
        *("cameras.bin", "frames.bin", "images.bin", "points3D.bin", "rigs.bin"),
    ]


def test_names_may_have_folders_and_fit_what_is_written(tmp_path):
    names = ["left/a.webp", "left/a.png", "right/a.webp", "right/b.bmp"]
    taken = photos(tmp_path / "photos", names)
    found = write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path, OutputRule())
    new = ["left/a.png", "left/a_2.png", "right/a.png", "right/b.png"]
    assert sorted(loaded(tmp_path).views(Split.TRAIN).names) == new
    written = [item for item in (tmp_path / "images").rglob("*") if item.is_file()]
    assert sorted(item.relative_to(tmp_path / "images").as_posix() for item in written) == new
    for item in written:
        with Image.open(item) as image:
            assert image.format == "PNG"
    assert found.notes == (
        "left/a.webp is named left/a_2.png, which fits its format (3 images have another name)",
    )


def test_the_number_of_jobs_changes_nothing(tmp_path):
    taken, estimated = photos(tmp_path / "photos"), estimate(lens("OPENCV"))
    contents = []
    for jobs in (1, 3):
        out = tmp_path / str(jobs)
        write_data_set(estimated, taken, out, OutputRule(), jobs)
        files = sorted(path for path in out.rglob("*") if path.is_file())
        contents.append([(path.relative_to(out), path.read_bytes()) for path in files])
    assert contents[0] == contents[1]
    assert len(contents[0]) > len(taken.images)


def test_images_that_are_not_registered_are_left_out(tmp_path):
    estimated = estimate(lens("OPENCV"))
    estimated.deregister_frame(estimated.images[2].frame_id)
    found = write_data_set(estimated, photos(tmp_path / "p"), tmp_path, OutputRule())
    names = ("view_0.png", "view_2.png", "view_3.png")
    assert loaded(tmp_path).views(Split.TRAIN).names == names
    assert sorted(item.name for item in (tmp_path / "images").iterdir()) == [*names]
    assert found.images == 3


def test_a_lens_that_folds_the_image_is_refused(tmp_path):
    taken = photos(tmp_path / "photos")
    with pytest.raises(
        DataError,
        match=r"(?s)camera 1 of sparse/0/cameras.bin: its distortion, .* folds.*"
        r"\nCompute it with fewer parameters \(camera_model=SIMPLE_RADIAL\)",
    ):
        write_data_set(estimate(lens("SIMPLE_RADIAL", (-0.9,))), taken, tmp_path, OutputRule())
