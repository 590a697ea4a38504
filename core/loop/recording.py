"""Recording: work on a GPU that is launched once, and repeated without the host's help."""

from __future__ import annotations

import gc
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import Protocol, runtime_checkable
from weakref import WeakKeyDictionary

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
            torch.OutOfMemoryError: memory is full.
        """

    @property
    def idle_memory(self) -> int:
        """Bytes that only recordings can use, beyond those of tensors."""
        return 0

    def release(self, at_once: bool = False) -> None:  # noqa: B027
        """Give memory back, once no recording is left.

        Args:
            at_once: all of it, for something else than further recordings.
        """


ENDS = ("_cuda_endAllocateToPool", "_cuda_endAllocateCurrentStreamToPool")
"""Functions of torch that end the allocations of a capture; torch 2.6 has the second one only."""

OUTGROWN = 2
"""Multiple of what the recordings of some rows took at which a pool is given back: further ones,
of more rows, find no block in it that is large enough, and it would grow with every refinement."""


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
        self._reserved = self._first = 0
        """Bytes of the pool, and those that the first rows took."""
        self._used: WeakKeyDictionary[_CudaRecording, int] = WeakKeyDictionary()
        """Bytes of the tensors that each recording keeps."""

    @property
    def idle_memory(self) -> int:
        """Bytes of the pool without those of tensors in it."""
        return max(self._reserved - sum(self._used.values()), 0)

    def release(self, at_once: bool = False) -> None:
        """Begin another pool, if this one has outgrown what recordings need."""
        self._first = self._first or self._reserved
        if at_once or self._reserved > OUTGROWN * self._first:
            self._pool, self._keeper = torch.cuda.graph_pool_handle(), None
            self._reserved = self._first = 0
            with suppress(RuntimeError):  # It refuses after a capture that has failed.
                torch.cuda.empty_cache()

    @contextmanager
    def working(self) -> Iterator[None]:
        """Run a block on the stream of this recorder."""
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
        reserved, used = torch.cuda.memory_reserved, torch.cuda.memory_allocated
        before = reserved(self._device), used(self._device)
        try:
            recording = _CudaRecording(self._captured(work))
        finally:
            self._reserved += reserved(self._device) - before[0]
        self._used[recording] = used(self._device) - before[1]
        return recording

    def _captured(self, work: Callable[[], object]) -> torch.cuda.CUDAGraph:
        graph = torch.cuda.CUDAGraph()
        try:
            with _without_garbage_collection():
                # Threads that decode and send images meanwhile may do what a capture forbids.
                graph.capture_begin(pool=self._pool, capture_error_mode="thread_local")
                work()
                graph.capture_end()
        except BaseException:
            self._abandon(graph)
            raise
        return graph

    def _abandon(self, graph: torch.cuda.CUDAGraph) -> None:
        """End a capture that has failed, for CUDA and for torch's allocator.

        Where CUDA says that it has failed, torch leaves its allocator as during a capture: memory
        would neither be given back nor be released (``CUDAGraph::capture_end`` of torch 2.13).
        """
        with suppress(RuntimeError):  # The capture has failed, and says so again.
            graph.capture_end()
        names = (name for name in ENDS if hasattr(torch._C, name))
        # Allocations have ended, and the graph releases its pool; or torch has neither function.
        with suppress(RuntimeError, StopIteration):
            getattr(torch._C, next(names))(self._stream.device_index, self._pool)
            torch._C._cuda_releasePool(self._stream.device_index, self._pool)


class _CudaRecording:
    """A CUDA graph."""

    def __init__(self, graph: torch.cuda.CUDAGraph) -> None:
        self._graph = graph

    def replay(self) -> None:
        """Launch the graph."""
        try:
            self._graph.replay()
        except RuntimeError as error:  # The first launch takes memory of the driver.
            if "out of memory" in str(error):
                raise torch.OutOfMemoryError(str(error)) from error
            raise


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Collect no garbage: graphs of an earlier run in it would be destroyed during a capture."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


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
