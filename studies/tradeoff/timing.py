"""Timing: how long variants take to draw, in rounds in which each has its turn."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.loop.device import wait_for
from gsfw.core.loop.memory import added_memory_mb
from gsfw.core.splats import Splats
from gsfw.studies.tradeoff.subject import Subject


@dataclass(frozen=True)
class Turn:
    """A variant with its splats ready to be drawn, as a viewer has them."""

    subject: Subject
    splats: tuple[Splats, ...]
    """For each camera: a moving model's are of its time."""
    cameras: Sequence[Cameras]

    @staticmethod
    def of(subject: Subject, cameras: Sequence[Cameras]) -> Turn:
        """Make the splats ready; what that takes is not measured, as no variant changes it."""
        if subject.is_still:
            return Turn(subject, (subject.splats(),) * len(cameras), cameras)
        times = [None if camera.time is None else camera.time[0] for camera in cameras]
        return Turn(subject, tuple(subject.splats(moment) for moment in times), cameras)

    def take(self, device: torch.device) -> float:
        """Draw every view once; milliseconds for a view, by the clock on the wall."""
        # After another's turn threads sleep and caches are cold, as they never are in a viewer:
        # one picture that does not count.
        self._draw_first()
        wait_for(device)
        started = time.perf_counter()
        for splats, camera in zip(self.splats, self.cameras, strict=True):
            self.subject.draw(splats, camera)
        wait_for(device)
        return 1e3 * (time.perf_counter() - started) / len(self.cameras)

    def memory(self, device: torch.device) -> float | None:
        """Draw the first view; megabytes that this takes, ``None`` where that is not known."""
        # What only the first picture of a variant takes stays for all that follow.
        self._draw_first()
        return added_memory_mb(self._draw_first, device)

    def _draw_first(self) -> None:
        self.subject.draw(self.splats[0], self.cameras[0])
