"""The fastest rasterizer of this machine, for tests that are not of rasterizers."""

from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def fast_rasterizer() -> Rasterizer:
    """The native kernels where they are built; the reference takes ten times as long."""
    return ReferenceRasterizer() if CpuRasterizer.capabilities().unavailable else CpuRasterizer()
