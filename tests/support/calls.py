"""What a piece of work asks of the host: operations of torch, and launches of kernels."""

import ctypes
from collections.abc import Sequence
from typing import Any

from emulation.launcher import EmulatedLauncher
from torch.utils._python_dispatch import TorchDispatchMode

from gsfw.kernels.cuda.launcher import Kernel, Launcher


class CountedLauncher(Launcher):
    """The emulation, and the names of the kernels that were started in it."""

    def __init__(self, seed: int = 0) -> None:
        self.launches: list[str] = []
        self._launcher = EmulatedLauncher(seed)

    def launch(self, kernel: Kernel, blocks: int, threads: int, job: ctypes.Structure) -> None:
        if blocks:
            self.launches.append(kernel.expression)
        self._launcher.launch(kernel, blocks, threads, job)


class Calls(TorchDispatchMode):
    """Notes what is dispatched to torch, and launched, while it is active."""

    def __init__(self, launcher: CountedLauncher) -> None:
        super().__init__()
        self.operations: list[str] = []
        self._launcher, self._before = launcher, len(launcher.launches)

    @property
    def launches(self) -> Sequence[str]:
        return self._launcher.launches[self._before :]

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None):
        self.operations.append(str(function))
        return function(*args, **(kwargs or {}))
