"""Cameras that stand still, each with its footage: the frames of synchronised recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from jaxtyping import Float64
from torch import Tensor

from gsfw.datamanagers.footage import Footage
from gsfw.datamanagers.frames import Frame
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.letterbox import fit_to_video


@dataclass(frozen=True)
class StandingCamera:
    """A camera that does not move, and what it has seen."""

    lens: Lens
    world_to_camera: Float64[Tensor, "4 4"]
    """Rigid, OpenCV axes, in the world of the data."""
    footage: Footage

    def fitted(self) -> tuple[StandingCamera, str]:
        """With its lens in pixels of its video, and a note where that took something.

        Raises:
            DataError: the video is not one of this lens.
        """
        if self.footage.video is None:
            return self, ""
        lens, video, note = fit_to_video(self.lens, self.footage.video)
        return replace(self, lens=lens, footage=replace(self.footage, video=video)), note

    def frame(self, number: int, camera: int, rate: float) -> Frame:
        """One picture of its footage.

        Raises:
            DataError: it is a file that is no picture.
        """
        path, shot = self.footage.source(number)
        return Frame(
            name=self.footage.name(number),
            path=path,
            header=self.footage.header(number),
            lens=self.lens,
            world_to_camera=self.world_to_camera,
            camera=camera,
            time=number / rate,
            shot=shot,
        )


def frames_of(
    cameras: Sequence[StandingCamera], times: range, rate: float
) -> tuple[list[Frame], tuple[str, ...]]:
    """The frames of all cameras at the given times, and notes on how lenses were fitted.

    Args:
        cameras: in the order that they are numbered in.
        times: numbers of the pictures.
        rate: pictures per second.

    Raises:
        DataError: a video is not one of its lens, or a file is no picture.
    """
    frames: list[Frame] = []
    notes: list[str] = []
    for index, camera in enumerate(cameras):
        fitted, note = camera.fitted()
        frames.extend(fitted.frame(number, index, rate) for number in times)
        notes.extend([note] if note else [])
    return frames, tuple(notes)
