"""CudaOnCpu: code that names CUDA devices runs on the CPU."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch.overrides import TorchFunctionMode

CPU = torch.device("cpu")


class CudaOnCpu(TorchFunctionMode):
    """While it is active, every tensor that is asked for on a GPU is made on the CPU.

    Costs about a microsecond for each call of a torch function.
    """

    def __enter__(self) -> CudaOnCpu:
        torch.cuda.Event = Event  # type: ignore[misc, assignment]
        torch.cuda.set_device = _nothing  # type: ignore[assignment]
        super().__enter__()
        return self

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401 - what the function returns
        """Call a function of torch with CPU where CUDA was said."""
        if func is torch.Tensor.cuda:
            return args[0]
        if func is torch.Tensor.to:
            args = (args[0], *map(_on_cpu, args[1:]))
        given = {name: _on_cpu(v) if name == "device" else v for name, v in (kwargs or {}).items()}
        return func(*args, **given)


class Event:
    """A point in time, as torch.cuda.Event."""

    def __init__(self, enable_timing: bool = False) -> None:
        self.enable_timing = enable_timing
        self.seconds = 0.0

    def record(self) -> None:
        """Take the time."""
        self.seconds = time.perf_counter()

    def elapsed_time(self, end: Event) -> float:
        """Milliseconds from this event to another."""
        return 1e3 * (end.seconds - self.seconds)


def _nothing(*_: object) -> None:
    """There is no GPU to do it on."""


def _on_cpu(value: Any) -> Any:  # noqa: ANN401 - any argument
    """The CPU for a CUDA device; everything else as it is."""
    is_cuda = isinstance(value, str | torch.device) and str(value).startswith("cuda")
    return CPU if is_cuda else value
