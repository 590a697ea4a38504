"""Settings of the reference rasterizer."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.config import RasterizerConfig
from gsfw.core.errors import ConfigError
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


@dataclass
class ReferenceConfig(RasterizerConfig):
    """Settings of the reference rasterizer."""

    chunk_mb: float = 16.0
    """Working memory of one chunk of tiles, in megabytes; fastest where it fits the caches."""

    def capabilities(self) -> Capabilities:
        """What it can do on this machine."""
        return ReferenceRasterizer.capabilities()

    def build(self, device: torch.device) -> ReferenceRasterizer:
        """The rasterizer; it draws wherever its inputs are, so ``device`` changes nothing.

        Raises:
            ConfigError: the chunk size is not positive.
        """
        if not self.chunk_mb > 0:
            raise ConfigError(
                f"rasterizer.chunk_mb={self.chunk_mb:g}: expected a number of megabytes above 0."
            )
        return ReferenceRasterizer(self.chunk_mb)
