"""Settings of the ray rasterizer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.config import RasterizerConfig
from gsfw.core.errors import ConfigError
from gsfw.rasterizers.ray.mode import Mode
from gsfw.rasterizers.ray.peak import Order, Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume


@dataclass
class RayConfig(RasterizerConfig):
    """Settings of the ray rasterizer."""

    mode: Literal["peak", "volume"] = "peak"
    """Each Gaussian at its largest response on the ray, or all as a density that is sampled."""
    order: Order = "mean"
    """Of peaks: by view depth of the means, as splatting has it, or by t* on each ray."""
    dilation: Literal["matched", "none"] = "matched"
    """Whether Gaussians grow across the ray by what splatting adds to their projection."""
    samples: int = 64
    """Of the volume, along each ray."""
    sampling: Literal["uniform", "stratified"] = "uniform"
    """Samples in the middle of their intervals, or at a random place in each."""
    sampling_seed: int = 0
    """Of random samples, which are the same each time that an image is rendered."""
    chunk_mb: float = 64.0
    """Working memory, in megabytes; more where a single ray takes more."""

    def capabilities(self) -> Capabilities:
        """What it can do on this machine."""
        return RayRasterizer.capabilities()

    def build(self, device: torch.device) -> RayRasterizer:
        """The rasterizer; it renders wherever its inputs are, so ``device`` changes nothing.

        Raises:
            ConfigError: there are no samples, there is no memory, or the seed is negative.
        """
        if self.samples < 1:
            raise ConfigError(f"rasterizer.samples={self.samples}: expected 1 or more.")
        if self.sampling_seed < 0:
            raise ConfigError(f"rasterizer.sampling_seed={self.sampling_seed}: expected 0 or more.")
        if not self.chunk_mb > 0:
            raise ConfigError(
                f"rasterizer.chunk_mb={self.chunk_mb:g}: expected a number of megabytes above 0."
            )
        mode: Mode = Peak(self.order)
        if self.mode == "volume":
            stratified = self.sampling == "stratified"
            mode = Volume(self.samples, self.sampling_seed if stratified else None)
        return RayRasterizer(mode, self.dilation == "matched", self.chunk_mb)
