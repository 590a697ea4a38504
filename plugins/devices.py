"""Devices: the device of a ``device`` setting, and the cause of an unused GPU."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from gsfw.core.capabilities import Capabilities
from gsfw.core.errors import ConfigError

WITHOUT_GPU = "Use device=cpu, or see gsfw doctor."


def find_device(name: str) -> torch.device:
    """Find the device of a ``device`` setting; a GPU with its number.

    Raises:
        ConfigError: there is no such device on this machine.
    """
    try:
        device = torch.device(name)
    except RuntimeError:
        device = None
    if device is None or device.type not in ("cpu", "cuda"):
        raise ConfigError(
            f"device={name}: expected auto, cpu, cuda, or cuda:N with the number of a GPU."
        )
    if device.type == "cpu":
        return torch.device("cpu")
    count = torch.cuda.device_count()
    if count == 0:
        raise ConfigError(f"device={name}: {_why_no_gpu()}", WITHOUT_GPU)
    if device.index is None:
        return torch.device("cuda", torch.cuda.current_device())
    if device.index >= count:
        numbers = "cuda:0 alone" if count == 1 else f"cuda:0 to cuda:{count - 1}"
        raise ConfigError(f"device={name}: this machine has {numbers}.", WITHOUT_GPU)
    return device


def _why_no_gpu() -> str:
    if torch.version.cuda is None:
        return f"this torch ({torch.__version__}) is built without CUDA."
    return f"torch (built for CUDA {torch.version.cuda}) sees no GPU on this machine."


def unused_gpu(able: Mapping[str, Capabilities]) -> tuple[str, ...]:
    """The cause why no GPU was chosen, in one sentence; empty if torch finds none.

    Args:
        able: capabilities of every installed rasterizer.
    """
    if not torch.cuda.is_available():
        return ()
    lost = [name for name, it in able.items() if it.unavailable and "cuda" in it.devices]
    if not lost:
        return ("there is a GPU, but no installed rasterizer that fits this run is faster there",)
    best = max(lost, key=lambda name: able[name].preference)
    return (f"there is a GPU, but rasterizer {best} cannot use it: {able[best].unavailable}",)
