"""Stage clock: what the stages of a picture take on the device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import torch


class StageClock:
    """Pairs of CUDA events around stages; reading them waits for the device.

    Does nothing unless ``measuring``.
    """

    def __init__(self, measuring: bool, device: torch.device) -> None:
        self._measuring = measuring
        self._device = device
        self._events: dict[str, tuple[torch.cuda.Event, torch.cuda.Event]] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what is launched within."""
        if not self._measuring:
            yield
            return
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        # Of the GPU that draws, which need not be the one that torch would take.
        stream = torch.cuda.current_stream(self._device)
        begin.record(stream)
        yield
        end.record(stream)
        self._events[name] = (begin, end)

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage so far; the same number for the device and for the wall."""
        if not self._events:
            return {}
        torch.cuda.synchronize(self._device)
        found = {name: begin.elapsed_time(end) for name, (begin, end) in self._events.items()}
        return {name: (time, time) for name, time in found.items()}
