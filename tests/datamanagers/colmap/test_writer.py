"""Recordings of any format written as COLMAP models."""

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
import torch
from support.small_captures import (
    projection_error,
    request,
    ring,
    write_colmap,
    write_images,
    write_transforms,
)

from gsfw.core.errors import DataError
from gsfw.core.maths.rotations import quaternions_of, rotation_vector_matrices
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.colmap.writer import write_model
from gsfw.datamanagers.lens import COEFFICIENTS, Lens
from gsfw.datamanagers.poses import pose_from_quaternion
from gsfw.datamanagers.transforms import TransformsConfig

SUFFIXES = (".bin", ".txt")


def source(folder, **settings):
    """A capture in another format, loaded."""
    write_images(folder / "images", ring())
    names = [f"images/{name}" for name in ring().names]
    write_transforms(folder / "transforms.json", replace(ring(), names=names), **settings)
    return TransformsConfig().build(request(folder))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_points_fall_where_they_did(tmp_path, suffix):
    data = source(tmp_path)
    write_model(data.recording, tmp_path / "sparse/0", tmp_path / "images", suffix)
    assert projection_error(ColmapConfig().build(request(tmp_path)), ring()) < 0.01


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_model_comes_back_as_it_was(tmp_path, suffix):
    write_colmap(
        tmp_path / "sparse/0", ring(), ".bin", "OPENCV", (70, 72, 31, 25, 0.1, 0.2, 0.01, 0)
    )
    write_images(tmp_path / "images", ring())
    before = ColmapConfig().build(request(tmp_path)).recording
    write_model(before, tmp_path / "again/sparse/0", tmp_path / "images", suffix)
    (tmp_path / "images").rename(tmp_path / "again/images")
    after = ColmapConfig().build(request(tmp_path / "again")).recording
    assert torch.equal(after.points, before.points)
    assert torch.equal(after.point_colors, before.point_colors)
    for old, new in zip(before.frames, after.frames, strict=True):
        assert (new.name, new.lens, new.camera) == (old.name, old.lens, old.camera)
        assert torch.allclose(new.world_to_camera, old.world_to_camera, rtol=0, atol=1e-14)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_pycolmap_reads_what_is_written(tmp_path, suffix):
    data = source(tmp_path)
    points = torch.from_numpy(ring().points)
    recording = replace(data.recording, points=points, point_colors=torch.full((20, 3), 0.5))
    write_model(recording, tmp_path / "sparse", tmp_path / "images", suffix)
    model = pycolmap.Reconstruction(tmp_path / "sparse")
    assert (model.num_cameras(), model.num_images(), model.num_points3D()) == (1, 4, 20)
    names = {image.name: image for image in model.images.values()}
    assert sorted(names) == ring().names
    for name, pose in zip(ring().names, ring().poses, strict=True):
        assert np.allclose(names[name].cam_from_world().matrix(), pose[:3], atol=1e-9)
    assert np.allclose(model.points3D[3].xyz, ring().points[2])
    assert model.points3D[3].color.tolist() == [128] * 3


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("model", COEFFICIENTS)
def test_every_model_is_written_with_its_parameters(tmp_path, suffix, model):
    recording = source(tmp_path).recording
    terms = tuple(0.01 * (i + 1) for i in range(len(COEFFICIENTS[model])))
    lens = Lens(70.0, 70.0, 31.0, 25.0, 64, 48, "here", model, terms)
    frames = tuple(replace(frame, lens=lens) for frame in recording.frames)
    recording = replace(recording, frames=frames)
    write_model(recording, tmp_path / "sparse", tmp_path / "images", suffix)
    config = ColmapConfig()
    found = config.recording(tmp_path, 1.0).frames[0].lens
    assert found == lens


def test_one_focal_length_becomes_two_where_images_were_shrunk_unevenly(tmp_path):
    recording = source(tmp_path).recording
    lens = Lens(140.0, 140.0, 62.0, 50.0, 129, 96, "here", "SIMPLE_RADIAL", (0.1,))
    frames = tuple(replace(frame, lens=lens) for frame in recording.frames)
    write_model(replace(recording, frames=frames), tmp_path / "sparse", tmp_path / "images")
    found = ColmapConfig().recording(tmp_path, 1.0).frames[0].lens
    assert found.model == "OPENCV"
    assert found.distortion == (0.1, 0.0, 0.0, 0.0)
    slopes = np.array([[0.1, -0.2], [0.3, 0.1]])
    wanted = lens.project(slopes) * (64 / 129, 48 / 96)
    assert np.abs(found.project(slopes) - wanted).max() < 1e-9


def test_physical_cameras_stay_apart(tmp_path):
    recording = source(tmp_path).recording
    frames = [replace(frame, camera=number % 2) for number, frame in enumerate(recording.frames)]
    recording = replace(recording, frames=tuple(frames))
    write_model(recording, tmp_path / "sparse", tmp_path / "images")
    found = ColmapConfig().recording(tmp_path, 1.0).frames
    assert [frame.camera for frame in found] == [0, 1, 0, 1]


def test_images_elsewhere_are_refused(tmp_path):
    recording = source(tmp_path / "set").recording
    (tmp_path / "other").mkdir()
    with pytest.raises(DataError, match=r"view_000.png is not in .*other, which the model's names"):
        write_model(recording, tmp_path / "sparse", tmp_path / "other")


def test_images_of_videos_are_refused(tmp_path):
    recording = source(tmp_path).recording
    first = recording.frames[0]
    object.__setattr__(first, "shot", "a shot")
    with pytest.raises(DataError, match=r"is an image of the video .* a COLMAP model cannot name"):
        write_model(recording, tmp_path / "sparse", tmp_path / "images")


def test_quaternions_are_those_of_their_rotations():
    generator = torch.Generator().manual_seed(3)
    vectors = [*torch.randn(20, 3, generator=generator, dtype=torch.float64)]
    vectors += [torch.tensor([torch.pi, 0, 0]).double(), torch.zeros(3, dtype=torch.float64)]
    for vector in vectors:
        rotation = rotation_vector_matrices(vector[None])[0]
        quaternion = tuple(quaternions_of(rotation).tolist())
        assert quaternion[0] >= 0
        back = pose_from_quaternion(quaternion, (0.0, 0.0, 0.0), "here")[:3, :3]
        assert torch.allclose(back, rotation, rtol=0, atol=1e-12)
