"""The registrations of core itself, through the same hooks as those of other plugins."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_operators() -> list[Spec]:
    """The torch defaults."""
    return [Spec("torch", "plain torch, on any device", "gsfw.core.operators:Operators")]


@hookimpl
def gsfw_metrics() -> list[Spec]:
    """The metrics of every evaluation."""
    return [
        Spec("psnr", "peak signal-to-noise ratio, dB", "gsfw.core.metrics:Psnr"),
        Spec("ssim", "structural similarity, 11x11 Gaussian window", "gsfw.core.metrics:Ssim"),
        Spec(
            "color_corrected_psnr",
            "PSNR after the best affine map of the render's colours, dB",
            "gsfw.core.metrics:ColorCorrectedPsnr",
        ),
    ]
