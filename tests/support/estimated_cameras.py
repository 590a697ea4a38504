"""Estimated cameras around a few points, exact, and the photos that they have taken."""

from pathlib import Path

import numpy as np
import pycolmap
import torch
from PIL import Image

from gsfw.core.datamanager import Split
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.images import read_header
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import ImageSet, SourceImage
from support.distorted_images import HEIGHT, WIDTH, parameters
from support.small_captures import request, ring

CPU = torch.device("cpu")
VIEWS = 4
CORNER = [[1.0, 1.0]]


def image(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Red tells the column, green the row, so that mixed colours tell a position."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = np.arange(width), np.arange(height)[:, None]
    pixels[..., 2] = 50 * number
    return pixels


def points() -> np.ndarray:
    """Around the middle of the ring, up to what the corners of images show."""
    return 1.7 * ring(VIEWS).points


def estimate(camera, names=None) -> pycolmap.Reconstruction:
    """Exact cameras of one lens and exact observations; each image has one more, of no point."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1,
            model=camera.model,
            width=camera.width,
            height=camera.height,
            params=parameters(camera),
        )
    )
    tracks = [[] for _ in points()]
    for view, pose in enumerate(ring(VIEWS).poses):
        local = points() @ pose[:3, :3].T + pose[:3, 3]
        seen = camera.project(local[:, :2] / local[:, 2:])
        inside = ((seen > 0) & (seen < (camera.width, camera.height))).all(axis=1)
        for place, point in enumerate(np.flatnonzero(inside)):
            tracks[point].append(pycolmap.TrackElement(view + 1, place))
        name = names[view] if names else f"view_{view}.png"
        image = pycolmap.Image(name, np.concatenate([seen[inside], CORNER]), 1, view + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for number, (place, track) in enumerate(zip(points(), tracks, strict=True)):
        point = pycolmap.Point3D()
        point.xyz, point.track = place, pycolmap.Track(track)
        model.add_point3D_with_id(10 + number, point)
    return model


def photos(folder: Path, names=None, **settings) -> ImageSet:
    """The images of an estimate, as files."""
    taken = []
    for view in range(VIEWS):
        name = names[view] if names else f"view_{view}.png"
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(image(view)).save(path, **settings)
        taken.append(SourceImage(name, path, read_header(path), Exif()))
    return ImageSet(tuple(taken))


def loaded(out: Path):
    return ColmapConfig().build(request(out))


def frames(data):
    return data.recording.frames


def images(data) -> list[torch.Tensor]:
    return [data.load(Split.TRAIN, [view], CPU)[0].images[0] for view in range(VIEWS)]
