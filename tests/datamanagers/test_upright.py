"""Upright frames: cameras of stored images are turned with their images."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from PIL.ExifTags import Base
from support.small_captures import HEIGHT, WIDTH, builder_of, ring, write_colmap, write_images

from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.frames import Frame
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.upright import upright

LENS = Lens(70.0, 72.0, 31.0, 25.5, 64, 48, "camera 1 of cameras.bin")
UPRIGHT = {
    6: lambda u, v: (48 - v, u),
    3: lambda u, v: (64 - u, 48 - v),
    8: lambda u, v: (v, 64 - u),
}
"""Pixels of the upright image of those of the stored image of 64 x 48."""
MODELS = {
    "PINHOLE": (),
    "RADIAL": (0.1, -0.05),
    "OPENCV": (0.1, -0.05, 0.02, -0.03),
    "FULL_OPENCV": (0.1, -0.05, 0.02, -0.03, 0.01, 0.02, -0.01, 0.005),
    "OPENCV_FISHEYE": (0.1, -0.05, 0.01, 0.02),
    "THIN_PRISM_FISHEYE": (0.1, -0.05, 0.02, -0.03, 0.01, 0.02, 0.03, -0.04),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *(0.1, -0.05, 0.01, 0.02, 0.01, -0.01), *(0.02, -0.03, 0.01, 0.02, 0.03, -0.04),
    ),
}  # fmt: skip


def frame(orientation: int, lens: Lens = LENS) -> Frame:
    sides = (48, 64) if orientation >= 5 else (64, 48)
    header = Header(*sides, has_alpha=False, orientation=orientation)
    return Frame("a.jpg", Path("a.jpg"), header, lens, torch.eye(4).double())


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("orientation", UPRIGHT)
def test_a_turned_camera_sees_points_where_the_turned_image_shows_them(orientation, model):
    even = "RADIAL" in model
    lens = replace(LENS, model=model, distortion=MODELS[model], fy=70.0 if even else 72.0)
    points = np.random.default_rng(0).uniform((-0.4, -0.3, 1), (0.4, 0.3, 1), (9, 3))
    turned = upright(frame(orientation, lens))
    local = points @ turned.world_to_camera[:3, :3].numpy().T
    u, v = lens.project(points[:, :2]).T
    wanted = np.stack(UPRIGHT[orientation](u, v), axis=1)
    assert np.allclose(turned.lens.project(local[:, :2] / local[:, 2:]), wanted, atol=1e-9)
    turned.camera_at(1.0)


def test_a_camera_with_the_sides_of_the_upright_image_stays():
    for given in (frame(6, replace(LENS, width=48, height=64)), frame(1)):
        assert upright(given) is given


@pytest.mark.parametrize("orientation", UPRIGHT)
def test_colmaps_cameras_of_photos_that_exif_turns_fit_the_upright_images(tmp_path, orientation):
    """COLMAP 3.x and 4.0 reconstruct from pixels as stored."""
    capture = ring()
    write_colmap(tmp_path / "sparse/0", capture)
    write_images(tmp_path / "images", capture)
    for file in (tmp_path / "images").iterdir():
        exif = Image.Exif()
        exif[Base.Orientation] = orientation
        Image.open(file).save(file, exif=exif)
    data = builder_of(ColmapConfig)(tmp_path)
    u, v = capture.pixels(0).T
    flips = {6: (HEIGHT - v, u), 3: (WIDTH - u, HEIGHT - v), 8: (v, WIDTH - u)}
    found = next(frame for frame in data.recording.frames if frame.name == capture.names[0])
    local = capture.points @ found.world_to_camera[:3, :3].numpy().T
    local = local + found.world_to_camera[:3, 3].numpy()
    seen = found.lens.project(local[:, :2] / local[:, 2:])
    assert np.allclose(seen, np.stack(flips[orientation], axis=1), atol=0.01)
