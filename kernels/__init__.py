"""Native code and its thin Python face: cpu (C++ with SIMD), cuda, and shared maths."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_operators() -> list[Spec]:
    """Faster sets of operators."""
    return [
        Spec("cpu", "SIMD kernels, on the CPU", "gsfw.kernels.cpu.operators:CpuOperators"),
        Spec("cuda", "CUDA kernels, on the GPU", "gsfw.kernels.cuda.operators:CudaOperators"),
    ]
