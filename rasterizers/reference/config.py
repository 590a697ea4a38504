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

    chunk_mb: float = 4.0
    """Working memory of one chunk of tiles, in megabytes; fastest where it fits the caches."""
    pairs_mb: float = 4096.0
    """Memory that the list of splats per tile may take, in megabytes; more is refused."""

    def capabilities(self) -> Capabilities:
        """What it can do on this machine."""
        return ReferenceRasterizer.capabilities()

    def build(self, device: torch.device) -> ReferenceRasterizer:
        """The rasterizer; it renders wherever its inputs are, so ``device`` changes nothing.

        Raises:
            ConfigError: an amount of memory is not positive.
        """
        for key, value in {"chunk_mb": self.chunk_mb, "pairs_mb": self.pairs_mb}.items():
            if not value > 0:
                raise ConfigError(
                    f"rasterizer.{key}={value:g}: expected a number of megabytes above 0."
                )
        return ReferenceRasterizer(self.chunk_mb, self.pairs_mb)
