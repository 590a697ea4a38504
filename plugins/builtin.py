"""What core itself brings to the registry, through the same hooks as everybody else."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_operators() -> list[Spec]:
    """The torch defaults."""
    return [Spec("torch", "plain torch, on any device", "gsfw.core.operators:Operators")]


@hookimpl
def gsfw_metrics() -> list[Spec]:
    """The figures every evaluation has."""
    return [
        Spec("psnr", "peak signal-to-noise ratio, dB", "gsfw.core.metrics:Psnr"),
        Spec("ssim", "structural similarity, 11x11 Gaussian window", "gsfw.core.metrics:Ssim"),
    ]
