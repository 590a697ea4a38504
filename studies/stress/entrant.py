"""Entrant: a rasterizer that is held to the catalogue, and where it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch

from gsfw.core.capabilities import Capabilities, Needs, check_fit
from gsfw.core.rasterizer import Rasterizer
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry

REFERENCE = "reference"
"""The rasterizer that all are measured against."""


@dataclass(frozen=True)
class Entrant:
    """A rasterizer and its device."""

    name: str
    rasterizer: Rasterizer
    capabilities: Capabilities
    device: torch.device
    threads: tuple[int, ...] = (1, 1)
    """Threads with which everything is drawn, and with which it is drawn again; one for not
    drawing it again."""


def entrants(names: Sequence[str], registry: Registry) -> tuple[list[Entrant], Mapping[str, str]]:
    """Build rasterizers with their default settings.

    Args:
        names: of rasterizers; empty for all that run here and draw what the reference draws.
        registry: what is installed.

    Returns:
        Those that run here, and why others do not, by name; only of those not asked for by name.

    Raises:
        ConfigError: one that is asked for by name is not there, or does not run here.
    """
    able = rasterizer_capabilities(registry)
    for name in names:
        registry.find("rasterizer", name)
        check_fit(name, {"gsfw stress": Needs()}, able, _device_of(able[name]))
    missing = {} if names else {name: _why_not(item) for name, item in able.items()}
    chosen = names or [name for name, why in missing.items() if not why]
    left_out = {name: why for name, why in missing.items() if why}
    return [entrant_of(name, registry) for name in chosen], left_out


def _why_not(able: Capabilities) -> str:
    """Why a rasterizer is left out unless it is asked for; empty for those that are not."""
    if able.unavailable:
        return able.unavailable
    if able.preference < 0:  # No run chooses it by itself, as it is another kind of picture.
        return "it draws by another rule than splatting's; name it to see how far apart they are."
    return ""


def entrant_of(name: str, registry: Registry) -> Entrant:
    """One rasterizer, on the CPU if it runs there."""
    config = load("rasterizer", registry.find("rasterizer", name))()
    able = config.capabilities()
    device = torch.device(_device_of(able))
    # Backends of the CPU say that the number of threads does not show; others have their own.
    threads = (1, 2) if device.type == "cpu" else (1, 1)
    return Entrant(name, config.build(device), able, device, threads)


def _device_of(able: Capabilities) -> str:
    return "cpu" if "cpu" in able.devices or not able.devices else min(able.devices)
