"""A scene that shows every wrong axis, for viewers that are not ours."""

import math
from dataclasses import replace

import numpy as np
import torch

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.camera_path import look_at
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.stress.case import random_splats

WIDTH, HEIGHT = 160, 120


def scene(degree: int) -> SplatFile:
    """Splats of many sizes and directions, far from the origin, with another shape from each side.

    Quaternions, colours and places have no symmetry: every wrong axis changes the image.
    """
    splats = random_splats(150, degree, dtype=torch.float64)
    assert splats.scales is not None
    generator = torch.Generator().manual_seed(2)
    stretch = torch.rand(150, 3, generator=generator, dtype=torch.float64) + 0.2
    middle = torch.tensor([0.8, -0.4, 0.6], dtype=torch.float64)
    moved = replace(
        splats,
        means=splats.means - splats.means.mean(0) + middle,
        scales=splats.scales * stretch,
        opacities=splats.opacities * 0.8 + 0.1,
    )
    return SplatFile(moved)


def cameras(splats: Splats) -> list[Cameras]:
    """Two cameras, at an angle."""
    middle = splats.means.mean(0)
    size = float((splats.means - middle).norm(dim=1).quantile(0.8))
    places = middle + size * 2.6 * torch.tensor([[0.3, -0.4, -0.9], [0.9, 0.2, 0.3]]).double()
    up = torch.tensor([0.1, -1.0, 0.0], dtype=torch.float64)
    focal = WIDTH / 2 / math.tan(math.radians(30))
    lens = torch.tensor([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]]).double()
    poses = look_at(places, middle, up)
    return [Cameras(pose[None], lens[None], WIDTH, HEIGHT) for pose in poses]


def ours(splats: Splats, camera: Cameras) -> np.ndarray:
    """The image that our rasterizer draws, [h w 3] in [0, 1]."""
    exact = splats.map(torch.Tensor.double)
    output = ReferenceRasterizer().render(exact, camera, RenderSettings())
    return output.color[0].clamp(0, 1).numpy()


def psnr(first: np.ndarray, second: np.ndarray) -> float:
    """PSNR of two images in [0, 1], in dB."""
    return -10 * math.log10(float(((first - second) ** 2).mean()))
