"""Start: the scene that a run starts from, with points that are found in its images.

``init=dense`` finds surface points, ``sky=true`` those of the sky.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from gsfw.core.background import parse_background
from gsfw.core.config import AUTO, DENSE, INIT_WORDS, StrategyConfig
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError
from gsfw.core.progress import stage
from gsfw.core.refinement.budget import BudgetSize
from gsfw.core.scene import Scene
from gsfw.core.sky import Sky, empty_sky
from gsfw.core.stereo.sky import found_sky
from gsfw.core.stereo.surface import SurfacePoints
from gsfw.plugins.dense_points import (
    Start,
    dense_count,
    dense_downscale,
    dense_start,
    dense_surface,
    small_views,
    views_of_places,
)
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Settings

FILE_NOTE = "sky=true: no sky is added to the splats of init=FILE; large ones far away are kept."


@dataclass(frozen=True)
class FoundPoints:
    """Points of a capture from its images; the same for all runs on it, whatever their size."""

    surface: SurfacePoints | str | None = None
    """All points of surfaces, or in a clause why there are too few; ``None``: not asked for."""
    sky: Sky | str | None = None
    """The sky, or in a clause why none is found; ``None``: not asked for."""


def find_points(
    settings: Settings, registry: Registry, data: DataManager, known: FoundPoints | None = None
) -> FoundPoints:
    """The points that a run starts from and that are in no file.

    Args:
        settings: settings of the run.
        registry: the installed parts.
        data: the capture as it is trained on.
        known: points of the capture that earlier runs on it have found.

    Raises:
        ConfigError: images with alpha have no sky.
    """
    config, found = settings.config, known or FoundPoints()
    if config.sky and data.scene.has_alpha:
        raise ConfigError(
            "sky=true: the images have alpha, so that nothing is behind what they show.",
            "Leave sky out, or composite the images on their backgrounds.",
        )
    needs_surface = config.init == DENSE and found.surface is None
    needs_sky = config.sky and config.init in INIT_WORDS and found.sky is None
    if not (needs_surface or needs_sky):
        return found
    downscale = _stereo_downscale(settings, data)
    images = data if downscale == config.downscale else open_data(settings, downscale)
    try:
        if needs_surface:
            given = config.background != AUTO
            background = torch.tensor(parse_background(config.background)) if given else None
            operators = choose_operators(registry, torch.device("cpu"))
            found = replace(found, surface=dense_surface(images, background, operators))
        return replace(found, sky=_sky_in(images)) if needs_sky else found
    finally:
        if images is not data:
            images.close()


def _sky_in(images: DataManager) -> Sky | str:
    """The sky in images of all times, or in a clause why there is none."""
    chosen = views_of_places(images.views(Split.TRAIN))
    if not chosen:
        return "it takes pinhole cameras, and there are none"
    views = small_views(images, chosen, None)
    with stage("looking for the sky"):
        return found_sky(views, _sphere(images.scene))


def _sphere(scene: Scene) -> Sky:
    return empty_sky(scene.camera_centers, scene.extent, scene.points)


def _stereo_downscale(settings: Settings, data: DataManager) -> float:
    """Factor by which images of the capture are to be shrunk, whatever the size of training."""
    if settings.config.downscale == 1:
        return dense_downscale(data)
    full = open_data(settings, 1.0)
    try:
        return dense_downscale(full)
    finally:
        full.close()


def start_of(settings: Settings, scene: Scene, found: FoundPoints) -> Start:
    """The scene that the model starts from, with the points that its images show.

    With sky=true its sphere is known to all parts, also where a file or a checkpoint brings it.
    """
    config, start = settings.config, Start(scene)
    if config.init == DENSE:
        assert found.surface is not None
        assert isinstance(config.strategy, StrategyConfig)
        most = config.dense_points or dense_count(scene.view_pixels)
        budget = BudgetSize.parse(config.strategy).rows
        if budget is not None:
            sky = len(found.sky) if isinstance(found.sky, Sky) else 0
            most = min(most, max(budget - sky, 1))
        start = dense_start(scene, found.surface, most)
    if not config.sky:
        return start
    start = _under_sky(start, scene, found.sky)
    if config.init in INIT_WORDS:
        return start
    return replace(start, notes=(*start.notes, FILE_NOTE))


def _under_sky(start: Start, capture: Scene, found: Sky | str | None) -> Start:
    """The start with a sky; capture has the points of the data, which set its distance."""
    if isinstance(found, Sky):
        note = f"Starting with {len(found):,} splats of the sky (sky=true)."
        return Start(replace(start.scene, sky=found), (*start.notes, note))
    without = () if found is None else (f"sky=true: {found}; starting without a sky.",)
    return Start(replace(start.scene, sky=_sphere(capture)), (*start.notes, *without))
