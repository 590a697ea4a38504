"""Determinism: same seed, same bits on the CPU; full float32 on a GPU."""

from __future__ import annotations

import platform
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
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

    torch has these switches once per process: threads that are inside at the same time share them.
    """
    with (_ALGORITHMS if device.type == "cpu" else _FLOAT32).on():
        yield


class _Switch:
    """A switch of the process: the first thread that needs it turns it, the last turns it back."""

    def __init__(self, turn: Callable[[], Callable[[], None]]) -> None:
        """Make a switch from a function that turns it, and returns one that turns it back."""
        self._turn, self._lock, self._users = turn, threading.Lock(), 0
        self._turn_back: Callable[[], None]

    @contextmanager
    def on(self) -> Iterator[None]:
        with self._lock:
            if not self._users:
                self._turn_back = self._turn()
            self._users += 1
        try:
            yield
        finally:
            with self._lock:
                self._users -= 1
                if not self._users:
                    self._turn_back()


def _deterministic_algorithms() -> Callable[[], None]:
    # use_deterministic_algorithms would also load torch's compiler, for over a second.
    before = torch.get_deterministic_debug_mode()
    fill = torch.utils.deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]
    torch.set_deterministic_debug_mode("error")
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]

    def turn_back() -> None:
        torch.set_deterministic_debug_mode(before)
        torch.utils.deterministic.fill_uninitialized_memory = fill  # type: ignore[attr-defined]

    return turn_back


def _full_float32() -> Callable[[], None]:
    cudnn: Any = torch.backends.cudnn
    # From torch 2.9 on the old switch cannot be read after a use of the new one.
    switches, name, full = (
        (cudnn.conv, "fp32_precision", "ieee")
        if hasattr(cudnn, "conv")
        else (cudnn, "allow_tf32", False)
    )
    before = getattr(switches, name)
    setattr(switches, name, full)
    return partial(setattr, switches, name, before)


_ALGORITHMS, _FLOAT32 = _Switch(_deterministic_algorithms), _Switch(_full_float32)


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
