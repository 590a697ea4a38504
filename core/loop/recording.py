"""Recording: work on a GPU that is launched once, and repeated without the host's help."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import Protocol, runtime_checkable

import torch


@runtime_checkable
class Recording(Protocol):
    """Recorded work, which reads and writes the same memory each time."""

    def replay(self) -> None:
        """Repeat the work on the current stream."""


class Recorder(ABC):
    """Records work that waits for nothing and moves nothing between the host and a GPU."""

    def working(self) -> AbstractContextManager[None]:
        """The context of all work of a run, whether recorded or not."""
        return nullcontext()

    @abstractmethod
    def record(self, work: Callable[[], None]) -> Recording:
        """Call ``work``, whose launches are recorded and not run; within ``working``.

        Raises:
            RuntimeError: it does something that cannot be recorded; nothing has been run.
        """


class CudaRecorder(Recorder):
    """CUDA graphs, which share their memory: they are replayed one after another.

    Nothing can be captured on the default stream, and autograd joins the streams of a parameter's
    earlier uses: so all steps of a run are on one stream, those that are not captured as well.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._stream = torch.cuda.Stream(device)
        self._pool = torch.cuda.graph_pool_handle()
        # torch forgets a pool that no graph uses, and then refuses it.
        self._keeper: torch.cuda.CUDAGraph | None = None

    @contextmanager
    def working(self) -> Iterator[None]:
        """On the stream of this recorder."""
        outside = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(outside)
        try:
            with torch.cuda.stream(self._stream):
                yield
        finally:
            outside.wait_stream(self._stream)

    def record(self, work: Callable[[], None]) -> Recording:
        """Capture a CUDA graph."""
        if self._keeper is None:
            self._keeper = self._captured(lambda: torch.zeros(1, device=self._device))
        return self._captured(work)

    def _captured(self, work: Callable[[], object]) -> torch.cuda.CUDAGraph:
        graph = torch.cuda.CUDAGraph()
        # Threads that decode and send images meanwhile may do what a capture forbids.
        graph.capture_begin(pool=self._pool, capture_error_mode="thread_local")
        try:
            work()
        except BaseException:
            with suppress(RuntimeError):  # The capture has failed, and says so again.
                graph.capture_end()
            raise
        graph.capture_end()
        return graph


@contextmanager
def on_default_stream(device: torch.device) -> Iterator[None]:
    """On the default stream of a GPU, in order with the work before and after; or on the CPU.

    Packages such as fused-ssim start their kernels there, whatever torch's current stream is. No
    other stream of torch waits for it: their kernels would read what is not yet written, and write
    to memory that earlier work still uses.
    """
    if device.type != "cuda":
        yield
        return
    outside, default = torch.cuda.current_stream(device), torch.cuda.default_stream(device)
    default.wait_stream(outside)
    try:
        with torch.cuda.stream(default):
            yield
    finally:
        outside.wait_stream(default)


def recorder_for(device: torch.device) -> Recorder | None:
    """The recorder of a device; ``None`` where the host runs the work itself."""
    return CudaRecorder(device) if device.type == "cuda" else None
