"""Orbit PSNR: the difference of two files of splats in images from all around."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.frame import transform_splats
from gsfw.core.metrics import PSNR_MAX
from gsfw.core.progress import tracked
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.plugins.open_rasterizer import open_rasterizer, render_needs
from gsfw.plugins.splat_run import surroundings

VIEWS = 12
"""Cameras around the splats."""
WIDTH, HEIGHT = 480, 270
"""Size of an image in pixels."""

View = Callable[[Cameras], Float[Tensor, "h w 3"]]


@torch.no_grad()
def orbit_psnr(before: SplatFile, after: SplatFile) -> float:
    """PSNR in dB of all pixels of ``VIEWS`` images of two files, at most ``PSNR_MAX``.

    The cameras stand around ``before`` as those of ``gsfw view FILE`` do, before black. Each file
    is rendered on the CPU as it asks to be: with or without antialiasing.
    """
    scene, cameras = surroundings("orbit", before)
    cameras = cameras[:: len(cameras) // VIEWS]
    first, second = _viewer(before, scene), _viewer(after, scene)
    errors = []
    for camera in tracked(cameras, "comparing images", len(cameras)):
        small = camera.resized(WIDTH, HEIGHT)
        errors.append((first(small) - second(small)).double().square().mean())
    return float((-10 * torch.stack(errors).mean().log10()).clamp_max(PSNR_MAX))


def _viewer(content: SplatFile, scene: Scene) -> View:
    """A function that renders a file."""
    moved = transform_splats(content.splats, scene.world_from_scene.inverse())
    splats = moved.map(torch.Tensor.float)
    settings = RenderSettings(antialias=content.antialiased)

    def image(camera: Cameras) -> Float[Tensor, "h w 3"]:
        rasterizer = open_rasterizer(needs=render_needs(splats, camera, settings))
        return rasterizer.render(splats, camera, settings).color[0].clamp(0, 1)

    return image
