"""Photo captures of the built-in scene on disk, with textures that features are found on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.maths.camera_path import look_at
from gsfw.core.one_thread import one_thread
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.synthetic.raycast import rays
from gsfw.datamanagers.synthetic.scene import SyntheticScene, solids
from gsfw.datamanagers.synthetic.textures import Texture, Waves
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureSettings, extract_features
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.matching import match_pairs
from gsfw.preparation.pairs import MatchingRule, plan_pairs

WIDTH, HEIGHT = 320, 240
FOCAL = 343.0
"""Pixels: 50 degrees across."""
DISTANCE = 3.0
"""Of every camera from the middle of the scene, in its units: the table fills the image."""
STEP = 10.0
"""Degrees from one camera to the next: every image overlaps with the next ten."""
TARGET = (0.0, 0.0, 0.1)
SAMPLES = 2
"""Per pixel along each axis."""


@dataclass(frozen=True)
class Speckled:
    """A texture with dark and bright spots, no two of which are alike."""

    texture: Texture
    spots: tuple[Waves, ...]

    def __call__(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, "3 n"]:
        """Colours of the surface."""
        noise = torch.stack([waves(points) for waves in self.spots]).mean(0)
        return (self.texture(points) * (1 + 0.9 * noise)).clamp(0, 1)


def speckled_scene() -> SyntheticScene:
    """The built-in scene, speckled."""
    generator = torch.Generator().manual_seed(5)

    def spots(size: float) -> tuple[Waves, ...]:
        return tuple(Waves.random(generator, 20.0 * size * times, 12) for times in (1, 2, 4))

    return SyntheticScene(
        tuple(
            replace(solid, texture=Speckled(solid.texture, spots(2.0 if index == 0 else 1.0)))
            for index, solid in enumerate(solids(0))
        ),
        0.0,
    )


def arc(count: int, first: float = 0.0, step: float = STEP, width=WIDTH, height=HEIGHT) -> Cameras:
    """Cameras on an arc around the scene, in turn high and low; angles in degrees."""
    number = torch.arange(count, dtype=torch.float64)
    azimuth = torch.deg2rad(first + step * number)
    rise = torch.deg2rad(38 + 10 * (2.1 * number).sin())
    target = torch.tensor(TARGET, dtype=torch.float64)
    ahead = torch.stack([rise.cos() * azimuth.cos(), rise.cos() * azimuth.sin(), rise.sin()], 1)
    poses = look_at(target + DISTANCE * ahead, target, torch.tensor([0.0, 0.0, 1.0]).double())
    focal = FOCAL * width / WIDTH
    matrix = torch.tensor([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Cameras(poses, matrix.double().expand(count, 3, 3), width, height)


def photos(cameras: Cameras) -> list[np.ndarray]:
    """What the cameras see, [h, w, 3] in 8 bits, before mid-grey."""
    scene, images = speckled_scene(), []
    wide, high = cameras.width * SAMPLES, cameras.height * SAMPLES
    y, x = torch.meshgrid(torch.arange(high), torch.arange(wide), indexing="ij")
    positions = (torch.stack([x.flatten(), y.flatten()]) + 0.5) / SAMPLES
    with one_thread():
        for index in range(len(cameras.world_to_camera)):
            origin, directions = rays(cameras.select([index]), positions.float())
            hits = scene.trace(origin, directions)
            colors = torch.where(hits.solid >= 0, scene.shade(hits, directions), 0.5)
            cells = colors.reshape(3, cameras.height, SAMPLES, cameras.width, SAMPLES)
            pixels = (cells.mean((2, 4)) * 255).round().to(torch.uint8)
            images.append(pixels.permute(1, 2, 0).numpy())
    return images


def write(folder: Path, images: Iterable[np.ndarray], extension: str = ".png") -> tuple[Path, ...]:
    """Images as photo_000.png and so on; JPEGs with a quality of 95."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, pixels in enumerate(images):
        paths.append(folder / f"photo_{number:03d}{extension}")
        Image.fromarray(pixels).save(paths[-1], quality=95)
    return tuple(paths)


def image_set(paths: Iterable[Path]) -> ImageSet:
    """The set of some files."""
    return ImageSet(
        tuple(SourceImage(path.name, path, read_header(path), Exif(), "") for path in paths),
        in_order=False,
    )


def one_group(images: ImageSet, focal: float = 1.2 * WIDTH) -> tuple[CameraGroup, ...]:
    """One camera for all; the guess at its focal length is wrong by a tenth."""
    header = images.images[0].header
    names = tuple(image.name for image in images.images)
    return (CameraGroup(1, "SIMPLE_RADIAL", header.width, header.height, focal, "", names),)


def database(folder: Path, n: int = 8) -> tuple[Path, ImageSet, Cameras]:
    """A database with features and verified matches of all pairs of an arc, and its truth.

    Takes 5 s for 8 images: keep it for a session. All of them register.
    """
    cameras = arc(n)
    images = image_set(write(folder / "photos", photos(cameras)))
    path = folder / "work" / "database.db"
    match_all(path, images)
    return path, images, cameras


def match_all(path: Path, images: ImageSet) -> None:
    """Features and matches of all pairs of a set whose images have one size."""
    settings = FeatureSettings(max_size=1600, count=2000, jobs=1)
    extract_features(path, images, one_group(images), settings)
    plan = plan_pairs(images, MatchingRule("exhaustive"), path)
    match_pairs(path, plan, 1)
