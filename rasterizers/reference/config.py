"""Settings of the reference rasterizer."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.config import RasterizerConfig
from gsfw.core.ranges import number
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


@dataclass
class ReferenceConfig(RasterizerConfig):
    """Settings of the reference rasterizer."""

    chunk_mb: float = number(4.0, above=0)
    """Working memory of one chunk of tiles, in megabytes; fastest where it fits the caches."""
    pairs_mb: float = number(4096.0, above=0)
    """Memory that the list of splats per tile may take, in megabytes; more is refused."""

    def capabilities(self) -> Capabilities:
        """Capabilities on this machine."""
        return ReferenceRasterizer.capabilities()

    def build(self, device: torch.device) -> ReferenceRasterizer:
        """The rasterizer; it renders wherever its inputs are, so ``device`` changes nothing."""
        return ReferenceRasterizer(self.chunk_mb, self.pairs_mb)
