"""Start: the scene that a run starts from, with points found in its images under init=dense."""

from __future__ import annotations

import torch

from gsfw.core.background import parse_background
from gsfw.core.config import AUTO, DENSE, StrategyConfig
from gsfw.core.datamanager import DataManager
from gsfw.core.refinement.budget import BudgetSize
from gsfw.core.scene import Scene
from gsfw.plugins.dense_points import (
    DenseStart,
    FoundSurface,
    dense_count,
    dense_downscale,
    dense_start,
    dense_surface,
)
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Settings


def find_surface(
    settings: Settings, registry: Registry, data: DataManager, known: FoundSurface | None = None
) -> FoundSurface | None:
    """The surface of a capture under init=dense; ``None`` for other starts.

    Args:
        settings: settings of the run.
        registry: the installed parts.
        data: the capture as it is trained on.
        known: the surface of the capture, found by an earlier run on it.
    """
    config = settings.config
    if config.init != DENSE:
        return None
    if known is not None:
        return known
    downscale = _stereo_downscale(settings, data)
    given = config.background != AUTO
    background = torch.tensor(parse_background(config.background)) if given else None
    images = data if downscale == config.downscale else open_data(settings, downscale)
    operators = choose_operators(registry, torch.device("cpu"))
    try:
        return FoundSurface(dense_surface(images, background, operators))
    finally:
        if images is not data:
            images.close()


def _stereo_downscale(settings: Settings, data: DataManager) -> float:
    """Factor by which images of the capture are to be shrunk, whatever the size of training."""
    if settings.config.downscale == 1:
        return dense_downscale(data)
    full = open_data(settings, 1.0)
    try:
        return dense_downscale(full)
    finally:
        full.close()


def start_of(settings: Settings, scene: Scene, surface: FoundSurface | None) -> DenseStart:
    """The scene that the model starts from, with points found in the images under init=dense."""
    config = settings.config
    if surface is None:
        return DenseStart(scene)
    assert isinstance(config.strategy, StrategyConfig)
    most = config.dense_points or dense_count(scene.view_pixels)
    most = min(most, BudgetSize.parse(config.strategy).rows or most)
    return dense_start(scene, surface.points, most)
