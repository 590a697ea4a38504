"""Preview: the first sight of a run on a page, drawn by the run's own rasterizer."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel, shrunk_to
from gsfw.core.datamanager import Split
from gsfw.core.exchange import Preview
from gsfw.core.loop.evaluation import render_model
from gsfw.core.maths.camera_path import gathered, viewing_center
from gsfw.core.maths.frame import in_frame
from gsfw.plugins.restore import Restored

VIEWS = 9
"""Most views of a preview: one for each digit key."""
LONGEST_SIDE = 1280
"""Longest side of the image, in pixels."""


@torch.no_grad()
def preview(restored: Restored) -> Preview:
    """Some training views, evenly from all of them, and the image of the first one."""
    composition = restored.composition
    parts, scene = composition.parts, composition.scene
    settings = composition.plan.settings
    cameras = [camera.to("cpu") for camera in parts.data.views(Split.TRAIN).cameras]
    views = replace(gathered(cameras), model=CameraModel.PINHOLE)
    world = scene.world_from_scene
    target = world.apply(viewing_center(views))
    step = max(1, -(-len(views) // VIEWS))
    chosen = views.select(slice(None, None, step))
    first = shrunk_to(replace(cameras[0], model=CameraModel.PINHOLE), LONGEST_SIDE).to(parts.device)
    time = None if first.time is None else torch.zeros((), device=parts.device)
    image = render_model(parts.model, parts.rasterizer, first, settings, time).color[0]
    background = (0.0, 0.0, 0.0) if settings.background is None else settings.background.tolist()
    red, green, blue = background
    return Preview(
        title=scene.name,
        views=in_frame(chosen, world),
        target=target,
        image=image.cpu(),
        background=(red, green, blue),
    )
