"""Settings of the CPU rasterizer."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.config import RasterizerConfig
from gsfw.core.ranges import number
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer


@dataclass
class CpuConfig(RasterizerConfig):
    """Settings of the CPU rasterizer."""

    pairs_mb: float = number(4096.0, above=0)
    """Memory that pairs of a splat and a tile may take, in megabytes; more is refused."""

    def capabilities(self) -> Capabilities:
        """Capabilities on this machine."""
        return CpuRasterizer.capabilities()

    def build(self, device: torch.device) -> CpuRasterizer:
        """The rasterizer; ``device`` has been checked to be the CPU."""
        return CpuRasterizer(self.pairs_mb)
