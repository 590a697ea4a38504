"""Quality of motion in closed form: images of it, compared with those of its model."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.datamanager import Split, spread
from gsfw.core.exchange import MotionFile
from gsfw.core.loop.evaluation import render_model
from gsfw.core.metrics import psnr
from gsfw.core.motion.evaluation import splats_at
from gsfw.core.progress import tracked
from gsfw.core.splats import Splats
from gsfw.plugins.restore import Restored

VIEWS = 8
"""Views and times that are compared."""
OFF_GRID = 0.47
"""Place of a time in its part of the sequence; samples lie at simple fractions of the sequence."""


@torch.no_grad()
def motion_psnr(restored: Restored, file: MotionFile) -> float:
    """PSNR in dB of images of a file, with those of its model as the truth.

    Training views, evenly spread, are rendered at times that are neither of the data nor sampled by
    the fit: the middles of equal parts of the sequence. The mean error of all pixels counts.

    Args:
        restored: the run.
        file: of its motion, in the scene frame.
    """
    parts, settings = restored.composition.parts, restored.composition.plan.settings
    cameras = parts.data.views(Split.TRAIN).cameras
    chosen = spread(range(len(cameras)), VIEWS)
    found: list[float] = []
    for place, index in enumerate(tracked(chosen, "comparing images", len(chosen))):
        moment = (place + OFF_GRID) / len(chosen)
        time = torch.tensor(moment, device=parts.device)
        camera = replace(cameras[index].to(parts.device), time=time[None])
        truth = render_model(parts.model, parts.rasterizer, camera, settings, time)
        splats = _single(splats_at(file, moment)).to(parts.device)
        output = parts.rasterizer.render(splats, camera, settings)
        found.append(10 ** (-psnr(output.color[0], truth.color[0]) / 10))
    return float(-10 * torch.tensor(found).mean().log10())


def _single(splats: Splats) -> Splats:
    """Splats in float32, as models have them."""
    return replace(splats, rows=None).map(lambda tensor: tensor.float())
