"""Settings of the gsplat rasterizer."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.config import RasterizerConfig
from gsfw.rasterizers.gsplat.rasterizer import GsplatRasterizer


@dataclass
class GsplatConfig(RasterizerConfig):
    """Settings of the gsplat rasterizer: none."""

    def capabilities(self) -> Capabilities:
        """Capabilities on this machine; does not import gsplat, which is slow."""
        return GsplatRasterizer.capabilities()

    def build(self, device: torch.device) -> GsplatRasterizer:
        """The rasterizer; it renders on the GPU that its inputs are on."""
        return GsplatRasterizer()
