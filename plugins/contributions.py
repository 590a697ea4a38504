"""Contributions: what each row of a run's model adds to its training views."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.datamanager import Split
from gsfw.core.loop.contributions import view_contributions
from gsfw.core.progress import tracked
from gsfw.core.splats import Splats
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.compose import Composition
from gsfw.plugins.registry import installed

MEASURES = Needs(features=frozenset({Feature.CONTRIBUTION}))
"""The need of a rasterizer that measures contributions."""


@torch.no_grad()
def training_contributions(composition: Composition) -> Float[Tensor, " n"] | None:
    """Sum over training views and pixels of alpha times transmittance, float64 on the CPU.

    A moving model is rendered at the time of each view. ``None`` where the run's rasterizer cannot
    measure contributions.
    """
    parts, settings = composition.parts, composition.plan.settings
    name = composition.settings.choices["rasterizer"].name
    if rasterizer_capabilities(installed())[name].lacking(MEASURES, parts.device.type):
        return None
    total = torch.zeros(parts.model.num_rows, dtype=torch.float64)
    cameras = parts.data.views(Split.TRAIN).cameras
    what = "measuring what each Gaussian adds to the training views"
    shown = tracked(cameras, what, len(cameras))
    seen = (camera.to(parts.device, torch.float32) for camera in shown)

    def splats_at(time: Float[Tensor, ""] | None) -> Splats:
        return parts.model.splats(time).map(lambda tensor: tensor.detach().float())

    for added in view_contributions(
        seen, splats_at, parts.rasterizer, settings, parts.model.num_rows
    ):
        total += added
    return total
