"""Recordings of any format written as transforms.json."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from support.small_captures import (
    projection_error,
    request,
    ring,
    write_colmap,
    write_images,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.lens import COEFFICIENTS, Lens
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.datamanagers.transforms_writer import NERFSTUDIO_MODELS, write_transforms


def source(folder, capture=None):
    """A COLMAP model with its images, loaded."""
    capture = capture or ring()
    write_images(folder / "images", capture)
    write_colmap(folder / "sparse/0", capture)
    return ColmapConfig().build(request(folder)).recording


def read(folder):
    return TransformsConfig().build(request(folder))


def content(folder) -> dict:
    return json.loads((folder / "transforms.json").read_text())


def with_frames(recording, change):
    """The recording with ``change(frame, number)`` for each frame."""
    frames = (change(frame, number) for number, frame in enumerate(recording.frames))
    return replace(recording, frames=tuple(frames))


def test_points_fall_where_they_did(tmp_path):
    size = write_transforms(source(tmp_path), tmp_path)
    named = replace(ring(), names=[f"images/{name}" for name in ring().names])
    assert projection_error(read(tmp_path), named) < 0.01
    files = (tmp_path / "transforms.json", tmp_path / "points.ply")
    assert size == sum(file.stat().st_size for file in files)


def test_poses_far_from_the_origin_keep_their_digits(tmp_path):
    before = source(tmp_path, ring(origin=(4.5e5, 5.2e6, 300.0)))
    write_transforms(before, tmp_path)
    for old, new in zip(before.frames, read(tmp_path).recording.frames, strict=True):
        center, moved = (
            pose.inverse()[:3, 3] for pose in (old.world_to_camera, new.world_to_camera)
        )
        assert torch.allclose(moved, center, rtol=0, atol=1e-8)
        rotations = (pose[:3, :3] for pose in (old.world_to_camera, new.world_to_camera))
        assert torch.allclose(*rotations, rtol=0, atol=1e-12)
    assert torch.equal(read(tmp_path).recording.points, before.points)


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_every_model_sees_rays_where_it_did(tmp_path, model):
    terms = tuple(0.002 * (i + 1) for i in range(len(COEFFICIENTS[model])))
    lens = Lens(70.0, 70.0, 31.0, 25.0, 64, 48, "here", model, terms)
    recording = with_frames(source(tmp_path), lambda frame, _: replace(frame, lens=lens))
    write_transforms(recording, tmp_path)
    found = read(tmp_path).recording.frames[0].lens
    slopes = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 2))
    assert np.abs(found.project(slopes) - lens.project(slopes)).max() < 1e-9
    assert content(tmp_path)["camera_model"] == NERFSTUDIO_MODELS.get(model, model)


def test_one_lens_is_written_once_and_several_with_their_frames(tmp_path):
    recording = source(tmp_path)
    write_transforms(recording, tmp_path)
    assert content(tmp_path)["fl_x"] == 70.0
    assert "fl_x" not in content(tmp_path)["frames"][0]
    several = with_frames(
        recording, lambda frame, number: replace(frame, lens=replace(frame.lens, fx=70.0 + number))
    )
    write_transforms(several, tmp_path)
    assert "fl_x" not in content(tmp_path)
    assert [frame.lens.fx for frame in read(tmp_path).recording.frames] == [70.0, 71.0, 72.0, 73.0]


def test_lenses_are_those_of_shrunk_images(tmp_path):
    recording = source(tmp_path)
    large = with_frames(
        recording, lambda frame, _: replace(frame, lens=frame.lens.resized(128, 96))
    )
    write_transforms(large, tmp_path)
    assert read(tmp_path).recording.frames[0].lens == recording.frames[0].lens


def test_every_list_of_names_is_there_where_one_is(tmp_path):
    recording = source(tmp_path)
    write_transforms(recording, tmp_path)
    assert not any(key.endswith("_filenames") for key in content(tmp_path))
    split = with_frames(
        recording, lambda frame, number: replace(frame, split=Split.EVAL if number == 1 else None)
    )
    write_transforms(split, tmp_path)
    held = ["images/view_001.png"]
    assert content(tmp_path)["test_filenames"] == content(tmp_path)["val_filenames"] == held
    assert read(tmp_path).views(Split.EVAL).names == tuple(held)
    assert len(content(tmp_path)["train_filenames"]) == 3


def test_times_and_cameras_come_back(tmp_path):
    recording = with_frames(
        source(tmp_path), lambda frame, number: replace(frame, time=2.0 * number, camera=number % 2)
    )
    write_transforms(recording, tmp_path)
    assert read(tmp_path).scene.time_range == (0.0, 6.0)
    assert [frame.camera for frame in read(tmp_path).recording.frames] == [0, 1, 0, 1]


def test_without_points_there_is_no_file_of_them(tmp_path):
    recording = source(tmp_path)
    none = replace(recording, points=recording.points[:0], point_colors=recording.point_colors[:0])
    write_transforms(none, tmp_path)
    assert "ply_file_path" not in content(tmp_path)
    assert not (tmp_path / "points.ply").exists()


def test_files_elsewhere_are_refused(tmp_path):
    recording = source(tmp_path / "set")
    (tmp_path / "other").mkdir()
    with pytest.raises(DataError) as error:
        write_transforms(recording, tmp_path / "other")
    assert str(error.value) == (
        f"{tmp_path}/set/images/view_000.png is not in {tmp_path}/other, which names in "
        "transforms.json are relative to.\n"
        "Copy the files there, or give a folder that holds all of them."
    )


def test_images_of_videos_are_refused(tmp_path):
    recording = source(tmp_path)
    object.__setattr__(recording.frames[0], "shot", "a shot")
    with pytest.raises(DataError, match=r"is an image of the video .* transforms.json cannot name"):
        write_transforms(recording, tmp_path)
