"""Device: synchronisation, and moving a saved state to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor


def wait_for(device: torch.device) -> None:
    """Wait until a GPU has finished its work; the CPU needs no wait."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def moved(state: Any, device: torch.device) -> Any:  # noqa: ANN401 - whatever a state holds
    """Move every tensor of a nested state to ``device``."""
    if isinstance(state, Tensor):
        return state.to(device)
    if isinstance(state, Mapping):
        return {key: moved(value, device) for key, value in state.items()}
    if isinstance(state, list | tuple):
        return type(state)(moved(value, device) for value in state)
    return state
