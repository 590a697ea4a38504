"""The rasterizer behind these interfaces: chosen by a program, by the environment, or by device."""

from __future__ import annotations

import os
from functools import lru_cache

import torch

from gsfw.api import CameraModel, Feature, Needs, NumericsProfile, Rasterizer, open_rasterizer

ENVIRONMENT = "GSFW_RASTERIZER"
"""Variable with the name of a rasterizer, as in ``gsfw train rasterizer=NAME``."""

_chosen: list[str] = []


def use_rasterizer(name: str) -> None:
    """Choose the rasterizer of this process, before or after the first image.

    Args:
        name: as in ``gsfw train rasterizer=NAME``; "auto" for the preferred one of the device.
    """
    _chosen[:] = [name]


def rasterizer_for(
    device: torch.device, features: frozenset[Feature], profile: NumericsProfile
) -> Rasterizer:
    """The chosen rasterizer.

    Args:
        device: of the tensors of a call.
        features: abilities that the call needs besides those of every call.
        profile: constants that it has to render with.

    Raises:
        ConfigError: there is none of this name, or it cannot do what is asked for; says which can.
    """
    name = _chosen[0] if _chosen else os.environ.get(ENVIRONMENT, "auto")
    return _opened(name, device, features, profile.name)


@lru_cache
def _opened(
    name: str, device: torch.device, features: frozenset[Feature], profile: str
) -> Rasterizer:
    needs = Needs(
        camera_models=frozenset({CameraModel.ORTHOGRAPHIC}),
        # Flat splats have no volume: the last one rules out rasterizers that do not project.
        features=features | {Feature.GRADIENT, Feature.COVARIANCES, Feature.SCREEN_GRADIENT},
        profile=profile,
    )
    return open_rasterizer(name, device, needs)
