"""Opening a rasterizer by name or by needs, for programs that render without a run."""

from __future__ import annotations

from functools import lru_cache

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature, Needs, check_fit, fitting, of_splatting
from gsfw.core.config import AUTO, RasterizerConfig
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry, installed

REFERENCE = "reference"
"""The backend with the most abilities: where it does not fit, it is named with what it lacks."""


def render_needs(splats: Splats, cameras: Cameras, settings: RenderSettings) -> Needs:
    """The needs of one render from a rasterizer, gradients included where tensors require them."""
    colors, is_tracked = splats.colors, torch.is_grad_enabled()
    features = {
        Feature.GRADIENT: is_tracked
        and any(tensor.requires_grad for tensor in splats.tensors().values()),
        Feature.POSE_GRADIENT: is_tracked and cameras.world_to_camera.requires_grad,
        Feature.SH: isinstance(colors, Sh),
        Feature.RAGGED_SH: isinstance(colors, Sh) and colors.offsets is not None,
        Feature.COVARIANCES: splats.covariances is not None,
        Feature.FLOAT64: splats.means.dtype == torch.float64,
    }
    return settings.needs() | Needs(
        camera_models=frozenset({cameras.model}),
        features=frozenset(feature for feature, is_needed in features.items() if is_needed),
        channels=splats.channels,
        extra_channels=0 if splats.extra is None else splats.extra.shape[1],
    )


def open_rasterizer(
    name: str = AUTO, device: torch.device | str = "cpu", needs: Needs | None = None
) -> Rasterizer:
    """Build an installed rasterizer with its default settings.

    Args:
        name: as in ``rasterizer=NAME``; "auto" for the fastest one of splatting's rule that
            fits.
        device: of the splats that it will render.
        needs: abilities that it must have, as ``render_needs`` returns them; ``None`` for none.

    Raises:
        ConfigError: there is no such backend, or it does not fit; names what it lacks.
    """
    device = torch.device(device)
    registry = installed()
    name = _fitting_name(registry, name, needs or Needs(), device.type)
    spec = registry.find("rasterizer", name)
    config: RasterizerConfig = load("rasterizer", spec)()
    return config.build(device)


@lru_cache(maxsize=64)  # Loops of small renders would wait for it: it asks every backend.
def _fitting_name(registry: Registry, name: str, needs: Needs, device: str) -> str:
    able = rasterizer_capabilities(registry)
    if name == AUTO:
        fits = fitting({"this render": needs}, of_splatting(able), device)
        name = fits[0] if fits else REFERENCE
    registry.find("rasterizer", name)
    check_fit(name, {"this render": needs}, able, device)
    return name
