"""Opening a rasterizer by name, for programs that render without a run."""

from __future__ import annotations

import torch

from gsfw.core.capabilities import Needs, check_fit, fitting
from gsfw.core.errors import ConfigError
from gsfw.core.rasterizer import Rasterizer
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed

AUTO = "auto"


def open_rasterizer(
    name: str = AUTO, device: torch.device | str = "cpu", needs: Needs | None = None
) -> Rasterizer:
    """Build an installed rasterizer with its default settings.

    Args:
        name: as in ``rasterizer=NAME``; "auto" for the preferred one that fits.
        device: of the splats that it will render.
        needs: abilities that it must have; ``None`` for none.

    Raises:
        ConfigError: no rasterizer of this name is installed, or it lacks an ability; names it.
    """
    device, registry = torch.device(device), installed()
    needs_by = {"this program": needs or Needs()}
    if name != AUTO:
        registry.find("rasterizer", name)
    able = rasterizer_capabilities(registry)
    if name == AUTO:
        fits = fitting(needs_by, able, device.type)
        if not fits:
            raise ConfigError(
                f"no installed rasterizer fits on device {device.type!r}.",
                "gsfw doctor lists the abilities of each.",
            )
        name = fits[0]
    check_fit(name, needs_by, able, device.type)
    return load("rasterizer", registry.find("rasterizer", name))().build(device)
