"""Plain text: names and values of result files as people read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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


def image_sizes(protocol: Mapping[str, Any]) -> str:
    """The sizes of compared images: "239 x 427 pixels (1/3 of their size)"; empty if unknown.

    Args:
        protocol: the measurement protocol of the figures.
    """
    sizes = short_sizes(protocol)
    downscale = number(protocol.get("downscale")) or 1.0
    part = f" (1/{downscale:.3g} of their size)" if downscale > 1 else ""
    return f"{sizes} pixels{part}" if sizes else ""


def short_sizes(protocol: Mapping[str, Any]) -> str:
    """The sizes of compared images for a narrow column: "239 x 427"; empty if unknown."""
    found = protocol.get("image_sizes")
    known = found if isinstance(found, list | tuple) else []
    sizes = [size for size in known if isinstance(size, list | tuple) and len(size) == 2]
    if not sizes:
        return ""
    sizes = sorted(sizes, key=lambda size: (number(size[0]) or 0.0) * (number(size[1]) or 0.0))
    least, most = plain(sizes[0]), plain(sizes[-1])
    between = "to" if len(sizes) > 2 else "or"
    return least if len(sizes) == 1 else f"{least} {between} {most}"


def growth(strategy: str) -> str:
    """A strategy as a phrase: "strategy error" alone would read like a failure."""
    return "no growth" if strategy == "none" else f"growth by {strategy}"


def setting_text(value: object) -> str:
    """A setting as it is written on the command line; a dash where a run has no such setting."""
    return "-" if value is None else as_text(value) or "(empty)"


def metric_text(name: str, value: float) -> str:
    """A value of a metric, without its unit."""
    if "psnr" in name:
        return f"{value:.2f}"
    return f"{value:.4f}" if abs(value) < 10 else f"{value:.4g}"
