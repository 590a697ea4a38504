"""CudaOnCpu: code that names CUDA devices runs on the CPU, without a change."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import torch
from torch.overrides import TorchFunctionMode

CPU = torch.device("cpu")
ASSUMED_MEMORY = 8 << 30
"""Bytes that a machine is said to have if its system does not tell."""


class CudaOnCpu(TorchFunctionMode):
    """While it is active, tensors that are asked for on a GPU are made on the CPU.

    It costs about a microsecond for each call of a torch function, and works in the thread that
    entered it and in processes that this thread forks. ``torch.cuda.is_available()`` stays False,
    since there is no GPU.

    Args:
        claim_gpu: let it be True, with one device, for scripts that end without a GPU.
    """

    def __init__(self, claim_gpu: bool = False) -> None:
        super().__init__()
        self._patches = PATCHES + CLAIMS if claim_gpu else PATCHES

    def __enter__(self) -> CudaOnCpu:
        # Every optimizer imports it; it keeps a list of torch's functions, and refuses what is
        # there under two names, as the functions here are.
        import_module("torch._dynamo")
        self._originals = [(owner, name, getattr(owner, name)) for owner, name, _ in self._patches]
        for owner, name, stand_in in self._patches:
            setattr(owner, name, stand_in)
        super().__enter__()
        return self

    def __exit__(self, *problem: Any) -> None:  # noqa: ANN401
        super().__exit__(*problem)
        for owner, name, original in self._originals:
            setattr(owner, name, original)

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401 - what the function returns
        """Call a function of torch with CPU where CUDA was said."""
        if func in (torch.Tensor.cuda, torch.Tensor.pin_memory):
            return args[0]
        if func is torch.Tensor.to:
            args = (args[0], *map(_on_cpu, args[1:]))
        elif func is torch.Tensor.type:
            args = (args[0], *map(_type_on_cpu, args[1:]))
        given = {name: _on_cpu(v) if name == "device" else v for name, v in (kwargs or {}).items()}
        return func(*args, **given)


class Event:
    """A point in time, as torch.cuda.Event: on the CPU nothing is pending."""

    def __init__(
        self, enable_timing: bool = False, blocking: bool = False, interprocess: bool = False
    ) -> None:
        self.seconds = 0.0

    def record(self, stream: object = None) -> None:
        """Take the time."""
        self.seconds = time.perf_counter()

    def elapsed_time(self, end: Event) -> float:
        """Milliseconds from this event to another."""
        return 1e3 * (end.seconds - self.seconds)

    def synchronize(self) -> None:
        """Return at once."""

    def query(self) -> bool:
        """True: everything is done."""
        return True


class Stream(nullcontext[None]):
    """A queue of work that is always empty, as torch.cuda.Stream."""

    def __init__(self, *_: object, **__: object) -> None:
        super().__init__()

    def synchronize(self) -> None:
        """Return at once."""

    def wait_stream(self, stream: object) -> None:
        """Return at once."""

    def wait_event(self, event: object) -> None:
        """Return at once."""


def _on_cpu(value: Any) -> Any:  # noqa: ANN401 - any argument
    """The CPU for a CUDA device; everything else as it is."""
    is_cuda = isinstance(value, str | torch.device) and str(value).startswith("cuda")
    return CPU if is_cuda else value


def _type_on_cpu(value: Any) -> Any:  # noqa: ANN401 - any argument
    """A type of CPU tensors for one of CUDA tensors, by name; everything else as it is."""
    return value.replace("torch.cuda.", "torch.") if isinstance(value, str) else value


def _nothing(*_: object, **__: object) -> None:
    """Do nothing: there is no GPU."""


def _zero(*_: object, **__: object) -> int:
    """The number of a device, or of bytes on it."""
    return 0


def _true(*_: object, **__: object) -> bool:
    return True


def _false(*_: object, **__: object) -> bool:
    return False


def _one() -> int:
    return 1


def _memory(*_: object) -> tuple[int, int]:
    """Free and total memory of the machine, in bytes; assumed where the system does not say."""
    total = _bytes("SC_PHYS_PAGES") or ASSUMED_MEMORY
    return _bytes("SC_AVPHYS_PAGES") or total, total


def _bytes(pages: str) -> int:
    """A number of pages in bytes; 0 on Windows, and for free pages on macOS."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf(pages)
    except (AttributeError, OSError, ValueError):
        return 0


def _name(*_: object) -> str:
    return "cpu"


@dataclass(frozen=True)
class Properties:
    """The machine, as torch.cuda.get_device_properties: the fields that scripts read."""

    name: str
    total_memory: int
    multi_processor_count: int
    major: int = 0
    minor: int = 0


def _properties(*_: object) -> Properties:
    return Properties(_name(), _memory()[1], os.cpu_count() or 1)


def _capability(*_: object) -> tuple[int, int]:
    """Compute capability 0.0: that of no GPU."""
    return 0, 0


def _random_state(*_: object) -> torch.Tensor:
    """The state of the CPU's generator, which draws all numbers here."""
    return torch.get_rng_state()


def _set_random_state(new_state: torch.Tensor, *_: object) -> None:
    torch.set_rng_state(new_state)


class Generator(torch.Generator):
    """A torch.Generator on the CPU, whatever device is named."""

    def __new__(cls, device: Any = CPU) -> Generator:  # noqa: ANN401
        """A generator."""
        return super().__new__(cls, _on_cpu(device))  # type: ignore[call-arg]


_load, _set_default_device = torch.load, torch.set_default_device


def _default_on_cpu(device: Any) -> None:  # noqa: ANN401
    """torch.set_default_device; its device is not an argument of the calls that it changes."""
    _set_default_device(_on_cpu(device))


def _load_on_cpu(f: Any, map_location: Any = None, *rest: Any, **named: Any) -> Any:  # noqa: ANN401
    """torch.load with the tensors of a GPU on the CPU."""
    place = CPU if map_location is None else _on_cpu(map_location)
    return _load(f, place, *rest, **named)


PATCHES: tuple[tuple[Any, str, Any], ...] = (
    # Time and order: on the CPU every call is done when it returns.
    *((torch.cuda, name, _nothing) for name in ("synchronize", "ipc_collect")),
    *((torch.cuda.nvtx, name, _nothing) for name in ("range_push", "range_pop", "mark")),
    (torch.cuda, "Event", Event),
    *((torch.cuda, name, Stream) for name in ("Stream", "stream", "current_stream")),
    # Devices: there is one.
    (torch.cuda, "device", nullcontext),
    (torch.cuda, "set_device", _nothing),
    (torch.cuda, "current_device", _zero),
    (torch.cuda, "get_device_name", _name),
    (torch.cuda, "get_device_properties", _properties),
    (torch.cuda, "get_device_capability", _capability),
    # Random numbers: those of the CPU.
    (torch.cuda, "get_rng_state", _random_state),
    (torch.cuda, "set_rng_state", _set_random_state),
    # Memory: nothing is on a GPU.
    *(
        (torch.cuda, name, _nothing)
        for name in ("empty_cache", "reset_peak_memory_stats", "reset_max_memory_allocated")
    ),
    *(
        (torch.cuda, name, _zero)
        for name in ("memory_allocated", "max_memory_allocated", "memory_reserved")
    ),
    (torch.cuda, "max_memory_reserved", _zero),
    (torch.cuda, "mem_get_info", _memory),
    # Tensors by type, and from files.
    *((torch.cuda, name, getattr(torch, name)) for name in ("FloatTensor", "LongTensor")),
    *((torch.cuda, name, getattr(torch, name)) for name in ("IntTensor", "BoolTensor")),
    (torch, "load", _load_on_cpu),
    (torch, "Generator", Generator),
    (torch, "set_default_device", _default_on_cpu),
)
"""Functions that are called directly, and so do not pass through the mode."""
CLAIMS: tuple[tuple[Any, str, Any], ...] = (
    (torch.cuda, "is_available", _true),
    (torch.cuda, "device_count", _one),
    (torch.cuda, "is_bf16_supported", _true),
    # Optimizers ask whether a GPU records them; a torch with CUDA would ask the driver.
    (torch.cuda, "is_current_stream_capturing", _false),
    (torch.accelerator, "current_accelerator", _nothing),
)
"""Functions that scripts ask for a GPU."""
