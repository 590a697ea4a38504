"""Determinism: same seed, same bits on the CPU; full float32 on a GPU."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import torch


@contextmanager
def deterministic(device: torch.device) -> Iterator[None]:
    """Run torch with deterministic algorithms on the CPU, and with full float32 on a GPU.

    Without the first, the backward pass of indexing with accumulation is not repeatable with two
    threads (observed with more than 50,000 rows). torch's fill of new memory stays off: it costs
    time and has no use here. On a GPU the same mode would refuse operators without a deterministic
    form, so it stays unchanged; but convolutions would by default round their inputs to the 11 bits
    of TF32, too few for SSIM, which subtracts squares.
    """
    with _deterministic_algorithms() if device.type == "cpu" else _full_float32():
        yield


@contextmanager
def _deterministic_algorithms() -> Iterator[None]:
    # use_deterministic_algorithms would also load torch's compiler, for over a second.
    before = torch.get_deterministic_debug_mode()
    fill = torch.utils.deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]
    torch.set_deterministic_debug_mode("error")
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    try:
        yield
    finally:
        torch.set_deterministic_debug_mode(before)
        torch.utils.deterministic.fill_uninitialized_memory = fill  # type: ignore[attr-defined]


@contextmanager
def _full_float32() -> Iterator[None]:
    cudnn: Any = torch.backends.cudnn
    # From torch 2.9 on the old switch cannot be read after a use of the new one.
    switches, name, full = (
        (cudnn.conv, "fp32_precision", "ieee")
        if hasattr(cudnn, "conv")
        else (cudnn, "allow_tf32", False)
    )
    before = getattr(switches, name)
    setattr(switches, name, full)
    try:
        yield
    finally:
        setattr(switches, name, before)


def environment(device: torch.device, backend: Mapping[str, str]) -> dict[str, str | int]:
    """The conditions of bit-exact repetition besides the seed; kept in every checkpoint.

    Args:
        device: device of the training.
        backend: details of the rasterizer, such as its instruction set.
    """
    return {
        **backend,
        "torch": str(torch.__version__),  # A class of its own, which checkpoints refuse to hold.
        "device": device.type,
        "threads": torch.get_num_threads(),
        "cpu_capability": torch.backends.cpu.get_cpu_capability(),
        "machine": platform.machine(),
    }


def differences(recorded: dict[str, str | int], now: dict[str, str | int]) -> list[str]:
    """Differences between two environments, as phrases."""
    return [
        f"{key} was {recorded[key]} and is {value}"
        for key, value in now.items()
        if key in recorded and recorded[key] != value
    ]
