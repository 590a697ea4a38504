"""Depth views: training views of a run, rendered with depth, in the world of its data."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel, Cameras, shrunk_to
from gsfw.core.capabilities import Feature
from gsfw.core.datamanager import Split, spread
from gsfw.core.exchange import DepthView
from gsfw.core.loop.evaluation import render_model
from gsfw.core.progress import tracked
from gsfw.core.render_settings import Depth
from gsfw.plugins.restore import Restored

MOST = 100
"""Views at most: of a dense capture the rest show nothing new."""
LONGEST_SIDE = 640
"""Pixels of a view at most; with all views they take 600 MB."""

FAINTEST = 1e-3
"""Coverage below which a pixel has no colour of its own."""


@torch.no_grad()
def depth_views(restored: Restored, time: float) -> list[DepthView]:
    """Render training views, evenly spread over all, with expected depth.

    Args:
        restored: the run.
        time: in [0, 1], of all views, whenever they were taken; a static model ignores it.

    Raises:
        ValueError: the rasterizer renders no depth.
    """
    composition = restored.composition
    parts, scene = composition.parts, composition.scene
    if Feature.DEPTH not in parts.rasterizer.capabilities().features:
        raise ValueError("its rasterizer renders no depth: add rasterizer=auto")
    black = torch.zeros(3, device=parts.device)
    settings = replace(composition.plan.settings, depth=Depth.EXPECTED, background=black)
    instant, world = torch.tensor(time, device=parts.device), scene.world_from_scene
    cameras = parts.data.views(Split.TRAIN).cameras
    chosen = spread(range(len(cameras)), MOST)
    views: list[DepthView] = []
    for index in tracked(chosen, "rendering depth", len(chosen)):
        camera = replace(_pinhole(cameras[index]).to(parts.device), time=None)
        output = render_model(parts.model, parts.rasterizer, camera, settings, instant)
        assert output.depth is not None
        pose = world.camera(camera.world_to_camera.cpu())
        moved = replace(camera.to("cpu", torch.float64), world_to_camera=pose)
        alpha = output.alpha[0].cpu()
        color = (output.color[0].cpu() / alpha.clamp_min(FAINTEST)).clamp(0, 1)
        depth = output.depth[0, ..., 0].cpu() * world.scale
        views.append(DepthView(moved, color, depth, alpha[..., 0], scene.up))
    return views


def _pinhole(camera: Cameras) -> Cameras:
    """A pinhole camera in the same place, of a limited size; 90 degrees wide for other models."""
    if camera.model is not CameraModel.PINHOLE:
        half = camera.width / 2
        lens = torch.tensor([[half, 0, half], [0, half, camera.height / 2], [0, 0, 1]])
        lens = lens.to(camera.intrinsics)[None]
        camera = replace(camera, model=CameraModel.PINHOLE, intrinsics=lens)
    return shrunk_to(camera, LONGEST_SIDE)
