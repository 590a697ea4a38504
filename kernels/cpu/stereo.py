"""Stereo in native code: plane sweeps with semi-global matching, and the fusion of depths."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.stereo.fusion import FusedImage, FusionRule
from gsfw.core.stereo.plane_sweep import DepthImage
from gsfw.core.stereo.plans import SweepPlan
from gsfw.core.stereo.views import StereoViews
from gsfw.kernels.cpu.native_module import required
from gsfw.kernels.cpu.threads import num_threads

REPRESENTS = 2
"""Kind of a pixel that is to represent its place; other confirmed ones have 1."""


def sweep_views(views: StereoViews, plans: Sequence[SweepPlan]) -> list[DepthImage]:
    """``Operators.sweep_views``."""
    sizes = [views.size(plan.view) for plan in plans]
    found = [DepthImage(*(torch.empty(size) for _ in range(3))) for size in sizes]
    required().sweep_views(
        [image.contiguous() for image in views.grey],
        views.world_to_camera.contiguous(),
        views.intrinsics.contiguous(),
        chosen=[plan.view for plan in plans],
        neighbors=[list(plan.neighbors) for plan in plans],
        near=[plan.near for plan in plans],
        far=[plan.far for plan in plans],
        planes=[plan.planes for plan in plans],
        depths=[image.depths for image in found],
        scores=[image.scores for image in found],
        contrasts=[image.contrasts for image in found],
        threads=num_threads(),
    )
    return found


def fuse_views(
    views: StereoViews,
    depths: Sequence[Float[Tensor, "_ _"]],
    neighbors: Sequence[Sequence[int]],
    rule: FusionRule,
) -> list[FusedImage]:
    """``Operators.fuse_views``."""
    kinds = [torch.empty(each.shape, dtype=torch.uint8) for each in depths]
    points = [torch.zeros(*each.shape, 3) for each in depths]
    required().fuse_views(
        [each.contiguous() for each in depths],
        views.world_to_camera.contiguous(),
        views.intrinsics.contiguous(),
        empty=[each.contiguous().view(torch.uint8) for each in views.empty],
        neighbors=[list(others) for others in neighbors],
        depth_tolerance=rule.depth_tolerance,
        pixel_tolerance=rule.pixel_tolerance,
        confirmations=rule.confirmations,
        contradictions=rule.contradictions,
        points=points,
        kinds=kinds,
        threads=num_threads(),
    )
    return [
        FusedImage(at, kind == REPRESENTS, kind > 0) for at, kind in zip(points, kinds, strict=True)
    ]
