"""Settings of the ray rasterizer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.config import RasterizerConfig
from gsfw.core.ranges import number
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
    """Order of peaks: by view depth of the means, as in splatting, or by t* on each ray."""
    dilation: Literal["matched", "none"] = "matched"
    """True if Gaussians grow across the ray by what splatting adds to their projection."""
    samples: int = number(64, at_least=1)
    """Number of samples of the volume along each ray."""
    sampling: Literal["uniform", "stratified"] = "uniform"
    """Samples in the middle of their intervals, or at a random place in each."""
    sampling_seed: int = number(0, at_least=0)
    """Seed of random samples, which are the same each time that an image is rendered."""
    chunk_mb: float = number(64.0, above=0)
    """Working memory, in megabytes; more where a single ray takes more."""

    def capabilities(self) -> Capabilities:
        """Capabilities on this machine."""
        return RayRasterizer.capabilities()

    def build(self, device: torch.device) -> RayRasterizer:
        """The rasterizer; it renders wherever its inputs are, so ``device`` changes nothing."""
        mode: Mode = Peak(self.order)
        if self.mode == "volume":
            stratified = self.sampling == "stratified"
            mode = Volume(self.samples, self.sampling_seed if stratified else None)
        return RayRasterizer(mode, self.dilation == "matched", self.chunk_mb)
