"""Recording: work on a GPU that is launched once, and repeated without the host's help."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

import torch


class Recording(Protocol):
    """Recorded work, which reads and writes the same memory each time."""

    def replay(self) -> None:
        """Repeat the work on the current stream."""


class Recorder(ABC):
    """Records work that waits for nothing and moves nothing between the host and a GPU."""

    @abstractmethod
    def record(self, work: Callable[[], None]) -> Recording:
        """Call ``work``, whose launches are recorded and not run.

        Raises:
            RuntimeError: it does something that cannot be recorded; nothing has been run.
        """


class CudaRecorder(Recorder):
    """CUDA graphs, which share their memory: they are replayed one after another."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._stream = torch.cuda.Stream(device)
        self._pool = torch.cuda.graph_pool_handle()

    def record(self, work: Callable[[], None]) -> Recording:
        """Capture a CUDA graph, on a stream of its own."""
        graph = torch.cuda.CUDAGraph()
        current = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(current)
        with torch.cuda.stream(self._stream):
            # Threads that decode and send images meanwhile may do what a capture forbids.
            graph.capture_begin(pool=self._pool, capture_error_mode="thread_local")
            try:
                work()
            finally:
                graph.capture_end()
        current.wait_stream(self._stream)
        return graph


def recorder_for(device: torch.device) -> Recorder | None:
    """The recorder of a device; ``None`` where the host runs the work itself."""
    return CudaRecorder(device) if device.type == "cuda" else None
