"""Settings of formats with several cameras: used times, and held-out cameras."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.ranges import number
from gsfw.core.words import suggestion
from gsfw.datamanagers.camera_sequence import (
    StandingCamera,
    common_length,
    common_rate,
    frames_of,
)
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.point_file import Points

NONE = "none"
"""For ``eval_cameras``: hold out no camera."""


@dataclass
class MultiCameraConfig(CaptureConfig, ABC):
    """Settings of formats whose images are those of several cameras at common times."""

    eval_cameras: tuple[str, ...] = ()
    """Cameras to hold out, by name. Empty: as papers do. none: single images (holdout_every)."""
    first: int = number(0, at_least=0)
    """Number of the first time that is used, counted from 0."""
    frames: int = number(0, at_least=0)
    """Number of used times; 0: all."""
    stride: int = number(1, at_least=1)
    """Every n-th time is used."""
    fps: float = number(0.0, at_least=0, below=math.inf)
    """Times per second. 0: as the videos say, or what is usual for the format."""

    @property
    def whole_cameras(self) -> bool:
        """False if the user wants no whole camera held out."""
        return tuple(self.eval_cameras) != (NONE,)

    def chosen_times(self, count: int, where: str) -> range:
        """The numbers of the times that are used, of ``count`` that there are.

        Raises:
            DataError: none is left.
        """
        chosen = range(self.first, count, self.stride)
        chosen = chosen[: self.frames] if self.frames else chosen
        if not chosen:
            raise DataError(
                f"{where} has {count} times, and datamanager.first={self.first} is after them.",
                "Lower datamanager.first.",
            )
        return chosen

    def times_note(self, chosen: range, count: int, rate: float, source: str) -> str:
        """The times that are used, and their rate."""
        if len(chosen) == count:
            used = f"{count} times"
        else:
            step = "" if self.stride == 1 else f", every {self.stride}. of them"
            used = f"{len(chosen)} of {count} times ({chosen[0]} to {chosen[-1]}{step})"
        return f"{used}, {rate:.5g} per second ({source})"

    def recording_of(
        self,
        cameras: Sequence[StandingCamera],
        folder: Path,
        notes: Sequence[str],
        held_out: int,
        points: tuple[Points, str],
    ) -> Recording:
        """The recording of cameras that stand still.

        Args:
            cameras: with their videos or folders of images.
            folder: place of the data set, after which it is named.
            notes: on the cameras.
            held_out: number of the first cameras that are held out unless the user names others.
            points: to start from, and the note on them.

        Raises:
            DataError: no time is left, or no camera to train on.
        """
        sequences = [camera.sequence for camera in cameras]
        names = [item.camera for item in sequences]
        rate, source = common_rate(sequences, self.fps)
        count, length_note = common_length(sequences)
        chosen = self.chosen_times(count, str(folder))
        frames, lens_notes = frames_of(cameras, chosen, rate)
        frames, origin = hold_out_cameras(frames, names, self.eval_cameras, names[:held_out])
        (positions, colors), point_note = points
        times_note = self.times_note(chosen, count, rate, source)
        return Recording(
            name=folder.resolve().name,
            path=folder,
            frames=tuple(frames),
            points=positions,
            point_colors=colors,
            notes=(*notes, times_note, *length_note, *lens_notes, point_note),
            split_origin=origin,
            whole_cameras=self.whole_cameras,
        )


def hold_out_cameras(
    frames: Sequence[Frame], names: Sequence[str], asked: Sequence[str], usual: Sequence[str] = ()
) -> tuple[list[Frame], str]:
    """The frames with their split by camera, and how it came about.

    Args:
        frames: ``Frame.camera`` is the number of a name.
        names: of the cameras.
        asked: cameras that the user wants held out; "none" for none, empty for ``usual``.
        usual: cameras that the format's papers hold out.

    Raises:
        DataError: there is no camera of a name, or none would be left to train on.
    """
    if tuple(asked) == (NONE,) or not (asked or usual):
        return [replace(frame, split=None) for frame in frames], ""
    held = {_find(name, names) for name in asked or usual}
    if len(held) == len(names):
        raise DataError(
            f"datamanager.eval_cameras={','.join(asked or usual)}: no camera is left to train on.",
            "Hold out fewer of them; datamanager.eval_cameras=none holds out none.",
        )
    splits = [Split.EVAL if number in held else Split.TRAIN for number in range(len(names))]
    noun = "camera" if len(held) == 1 else "cameras"
    why = "" if asked else ", as papers do"
    return (
        [replace(frame, split=splits[frame.camera]) for frame in frames],
        f"{noun} {', '.join(names[number] for number in sorted(held))}{why}",
    )


def _find(name: str, names: Sequence[str]) -> int:
    if name in names:
        return names.index(name)
    hint = suggestion(name, names)
    raise DataError(
        f"datamanager.eval_cameras={name}: there is no camera of this name.{hint}",
        f"The cameras are {', '.join(names)}.",
    )
