"""Settings of the CUDA rasterizer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from gsfw.core.capabilities import Capabilities, Determinism
from gsfw.core.config import RasterizerConfig
from gsfw.core.ranges import number
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from gsfw.rasterizers.cuda.tested_gpus import check_gpu


@dataclass
class CudaConfig(RasterizerConfig):
    """Settings of the CUDA rasterizer."""

    pairs_mb: float = number(16384.0, above=0)
    """Memory that pairs of a splat and a tile may take, in megabytes; more is refused."""
    deterministic: bool = False
    """Sum gradients in a fixed order, so that a run gives the same bits each time; takes memory."""
    time_stages: bool = False
    """Measure each stage of an image, for which the host waits for the device."""
    self_test: bool = True
    """Test a GPU once, before the first image, and refuse it where images would be wrong."""

    def capabilities(self) -> Capabilities:
        """Capabilities on this machine, with these settings."""
        kind = Determinism.BITWISE if self.deterministic else Determinism.NONE
        return replace(CudaRasterizer.capabilities(), determinism=kind)

    def build(self, device: torch.device) -> CudaRasterizer:
        """The rasterizer for one GPU.

        Raises:
            CudaError: the GPU does not pass the self-test, or CUDA cannot be used.
        """
        launcher = cuda_launcher(device)
        if self.self_test:
            check_gpu(device)
        return CudaRasterizer(launcher, self.pairs_mb, self.deterministic, self.time_stages)
