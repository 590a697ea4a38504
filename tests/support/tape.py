"""A tape: records what is launched and dispatched, and repeats it, as a CUDA graph does."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import torch
from emulation.launcher import EmulatedLauncher
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from gsfw.core.loop.recording import Recorder
from gsfw.kernels.cuda.launcher import Kernel, Launcher

aten = torch.ops.aten

READS = {
    aten._local_scalar_dense.default,
    aten.nonzero.default,
    aten.masked_select.default,
    aten.equal.default,
    aten._unique2.default,
    aten.unique_consecutive.default,
    aten.bincount.default,
    aten.repeat_interleave.Tensor,
}
"""Operations for whose result, or its size, the host waits."""

MAKES = {
    *(torch.tensor, torch.as_tensor, torch.zeros, torch.ones, torch.full, torch.empty, torch.eye),
    *(torch.arange, torch.linspace, torch.rand, torch.randn, torch.randint, torch.randperm),
}
"""Functions that make a tensor, on the CPU unless they are given a device."""

BY_INDEX = {aten.index.Tensor, aten.index_put_.default, aten.index_put.default}
"""Operations by indices, or by a mask, whose rows have to be counted."""


def _refuse_what_waits(function: Any, args: Any, named: Any) -> None:
    masks = function in BY_INDEX and any(
        index is not None and index.dtype in (torch.bool, torch.uint8) for index in args[1]
    )
    if function is aten.repeat_interleave.Tensor and named.get("output_size") is not None:
        return
    if masks or function in READS:
        raise RuntimeError("the host reads a number, which a graph does not allow")
    if function is aten.lift_fresh.default:
        raise RuntimeError("the host sends numbers, which a graph does not allow")


class OnDevice(TorchFunctionMode):
    """Refuses tensors of the CPU, which would have to be sent, and numbers of its generators."""

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None):
        named = kwargs or {}
        if function in MAKES and named.get("device") is None:
            raise RuntimeError(f"{function.__name__} makes a tensor without a device")
        if named.get("generator") is not None:
            raise RuntimeError("a generator's numbers would be the same in every replay")
        return function(*args, **named)


class Tape(TorchDispatchMode):
    """Everything in order; what it has once allocated stays."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[Callable[[], None]] = []

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None):
        named = kwargs or {}
        _refuse_what_waits(function, args, named)
        first = function(*args, **named)
        # Views of their own: an operation such as squeeze_ changes the shape of a result.
        held = [leaf.detach() if isinstance(leaf, Tensor) else leaf for leaf in tree_leaves(first)]

        def repeat() -> None:
            again = function(*args, **named)
            for old, new in zip(held, tree_leaves(again), strict=True):
                if isinstance(old, Tensor) and old.data_ptr() != new.data_ptr():
                    old.copy_(new)

        self.calls.append(repeat)
        return first

    def replay(self) -> None:
        with torch.no_grad():
            for call in self.calls:
                call()


class TapeLauncher(Launcher):
    """The emulation, whose launches go onto the tape that is recording.

    Blocks run in order, so that a replay has the bits of the step itself, whatever room it has.
    """

    def __init__(self) -> None:
        self.tape: Tape | None = None
        self._launcher = EmulatedLauncher(seed=0)

    def captures(self) -> bool:
        return self.tape is not None

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        if self.tape is not None:
            kept = type(job).from_buffer_copy(job)
            launch = self._launcher.launch
            self.tape.calls.append(lambda: launch(kernel, blocks, threads, kept))
        self._launcher.launch(kernel, blocks, threads, job)


class TapeRecorder(Recorder):
    """Recordings that leave the state as it was, since a graph does not run what it records."""

    def __init__(self, launcher: TapeLauncher, state: Callable[[], Sequence[Tensor]]) -> None:
        self.recorded = 0
        self._launcher, self._state = launcher, state

    def record(self, work: Callable[[], None]) -> Tape:
        held = [(tensor, tensor.detach().clone()) for tensor in self._state()]
        tape = self._launcher.tape = Tape()
        try:
            with tape, OnDevice():
                work()
        finally:
            self._launcher.tape = None
            with torch.no_grad():
                for tensor, before in held:
                    tensor.copy_(before)
        self.recorded += 1
        return tape
