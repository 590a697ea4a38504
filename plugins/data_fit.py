"""Data fit: whether an opened data set fits the method, the rasterizer and the device of a run."""

from __future__ import annotations

import torch

from gsfw.core.capabilities import Needs, check_fit
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.method import Method
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.devices import find_device
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Settings


def check_rasterizer(
    settings: Settings, registry: Registry, needs: dict[str, Needs], device: torch.device
) -> None:
    """Check that the chosen rasterizer meets the needs.

    Raises:
        ConfigError: names a need that it does not meet, and the rasterizers that do.
    """
    chosen = settings.choices["rasterizer"].name
    check_fit(chosen, needs, rasterizer_capabilities(registry), device.type)


def check_data(settings: Settings, registry: Registry, data: DataManager, method: Method) -> None:
    """Check that an opened data set fits the method and the rasterizer; reads no image.

    Raises:
        ConfigError: the parts and the scene do not fit together.
        DataError: no view is left to train on.
    """
    scene, views = data.scene, data.views(Split.TRAIN)
    if len(views) == 0:
        raise DataError(
            f"{settings.config.data or scene.name}: no view is left to train on.",
            "Hold out fewer images (holdout_every=0 holds out none).",
        )
    cameras = [*views.cameras, *data.views(Split.EVAL).cameras]
    needs = Needs(camera_models=frozenset(camera.model for camera in cameras))
    device = find_device(settings.config.device)
    check_rasterizer(settings, registry, {f"data set {scene.name!r}": needs}, device)
    method.check_scene(scene)
    if settings.config.ignore_distractors and scene.is_dynamic:
        raise ConfigError(
            f"ignore_distractors=true leaves out what moves, and {scene.name!r} was captured at "
            f"{scene.num_times} different times: its motion is part of the scene.",
            "Leave out ignore_distractors, or mask the pixels that are not to be learnt "
            "(datamanager.masks=DIR).",
        )
