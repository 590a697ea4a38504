"""Plain text: names and values of result files as people read them."""

from __future__ import annotations

from collections.abc import Mapping

from gsfw.plugins.values import as_text
from gsfw.reports.run_record import number


def plain(value: object) -> str:
    """A value of a result file for people."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {plain(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        if len(value) == 2 and all(isinstance(item, int) for item in value):
            return f"{value[0]} x {value[1]}"
        return ", ".join(map(plain, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    found = number(value)
    if found is not None:
        return f"{value:,}" if isinstance(value, int) else f"{found:.6g}"
    return "-" if value is None or value == "" else str(value)


def setting_text(value: object) -> str:
    """A setting as it is written on the command line; a dash where a run has no such setting."""
    return "-" if value is None else as_text(value) or "(empty)"


def metric_name(name: str) -> str:
    """The name of a metric: "moving_psnr" is "moving PSNR"."""
    words = name.replace("_", " ")
    return words.replace("psnr", "PSNR").replace("ssim", "SSIM").replace("lpips", "LPIPS")


def metric_text(name: str, value: float) -> str:
    """A value of a metric, without its unit."""
    if "psnr" in name:
        return f"{value:.2f}"
    return f"{value:.4f}" if abs(value) < 10 else f"{value:.4g}"
