"""TorchDevice: what launching kernels asks of torch."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import torch


def _current_stream(index: int) -> int:
    return torch.cuda.current_stream(index).cuda_stream


class TorchDevice:
    """One of torch's CUDA devices."""

    def __init__(self, device: torch.device) -> None:
        torch.cuda.init()
        self.index: int = torch.cuda.current_device() if device.index is None else device.index
        # Private, but Triton and torch's own compiler rely on it: it costs a twentieth of the
        # public way, which makes an object per call.
        private = getattr(torch._C, "_cuda_getCurrentRawStream", None)
        self._stream: Callable[[int], int] = private or _current_stream
        private = getattr(torch._C, "_cuda_getDevice", None)
        self._current: Callable[[], int] = private or torch.cuda.current_device

    def is_current(self) -> bool:
        """True if it is torch's current device in this thread; much cheaper than ``selected``."""
        return self._current() == self.index

    def selected(self) -> AbstractContextManager[object]:
        """Makes the device torch's current one for a while."""
        return torch.cuda.device(self.index)

    def stream(self) -> int:
        """The handle of the stream that torch is using on the device in this thread."""
        return self._stream(self.index)

    def capturing(self) -> bool:
        """True if launches are recorded into a CUDA graph instead of being run."""
        if self.is_current():
            return torch.cuda.is_current_stream_capturing()
        with self.selected():  # torch asks the stream of its current device.
            return torch.cuda.is_current_stream_capturing()

    def architecture(self) -> int:
        """Ten times the compute capability."""
        major, minor = torch.cuda.get_device_capability(self.index)
        return 10 * major + minor
