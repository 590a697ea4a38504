"""The ``colmap-per-frame`` format: a COLMAP model for each time, in colmap_0, colmap_1, ...

The layout of Li et al. 2024 (Spacetime Gaussians): cameras stand still and have the same names in
all of the models, and each model holds the points that were triangulated at its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np
import torch

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.ranges import number
from gsfw.datamanagers.camera_sequence import common_rate
from gsfw.datamanagers.colmap.config import frames_of
from gsfw.datamanagers.colmap.model import ColmapModel, model_folders
from gsfw.datamanagers.colmap.reader import read_model
from gsfw.datamanagers.frames import Frame, Recording, missing_images
from gsfw.datamanagers.multi_camera import MultiCameraConfig, hold_out_cameras

PREFIX = "colmap_"
LOOKED_FOR = f"{PREFIX}0, {PREFIX}1, ... with a COLMAP model in each"


@dataclass(frozen=True)
class _Instant:
    """One of the folders."""

    number: int
    folder: Path
    model: ColmapModel
    frames: list[Frame]
    missing: list[str]


@dataclass
class ColmapPerFrameConfig(MultiCameraConfig):
    """Settings of the ``colmap-per-frame`` format. By default the first camera is held out."""

    points_every: int = number(1, at_least=1)
    """Points of every n-th time are used; all of them may be millions."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with at least one colmap_N that holds a model."""
        folders = _folders(path)
        if not folders or not model_folders(folders[min(folders)]):
            return Detection(False, LOOKED_FOR)
        first, last = min(folders), max(folders)
        return Detection(True, LOOKED_FOR, f"{PREFIX}{first} to {PREFIX}{last}", priority=45)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read all models and the headers of the images."""
        folders = _folders(path)
        if not folders:
            raise DataError(
                f"{path} contains no {PREFIX}0, {PREFIX}1, ...", "Give the folder that contains it."
            )
        numbers = sorted(folders)
        chosen = self.chosen_times(len(numbers), str(path))
        instants = [_read(numbers[place], folders[numbers[place]]) for place in chosen]
        rate, source = common_rate((), self.fps)
        missing = [name for instant in instants for name in instant.missing]
        total = len(missing) + sum(len(instant.frames) for instant in instants)
        missing_note = missing_images(missing, total, path)
        frames, names = _numbered(instants, rate)
        frames, origin = hold_out_cameras(frames, names, self.eval_cameras, names[:1])
        seen = instants[:: self.points_every]
        counts = torch.tensor([len(instant.model.points) for instant in seen])
        times = torch.tensor([instant.number / rate for instant in seen], dtype=torch.float64)
        colors = np.concatenate([instant.model.colors for instant in seen])
        points_note = f"{int(counts.sum())} points of {len(seen)} times"
        return Recording(
            name=path.resolve().name,
            path=path,
            frames=tuple(frames),
            points=torch.from_numpy(np.concatenate([instant.model.points for instant in seen])),
            point_colors=torch.from_numpy(colors).float() / 255,
            notes=(
                f"{path}: {len(names)} cameras",
                self.times_note(chosen, len(numbers), rate, source),
                *missing_note,
                points_note,
            ),
            up="-y",
            point_times=times.repeat_interleave(counts),
            split_origin=origin,
            whole_cameras=self.whole_cameras,
        )


def _folders(path: Path) -> dict[int, Path]:
    """The folders by their number."""
    found = path.glob(f"{PREFIX}*") if path.is_dir() else ()
    return {
        int(number): folder
        for folder in found
        if (number := folder.name.removeprefix(PREFIX)).isdecimal() and folder.is_dir()
    }


def _read(number: int, folder: Path) -> _Instant:
    """The model of one time, and its images.

    Raises:
        DataError: there is no model, or it is damaged.
    """
    models = model_folders(folder)
    if not models:
        raise DataError(
            f"{folder} contains no COLMAP model.",
            "Every time needs one; choose times that have (datamanager.first, .frames, .stride).",
        )
    model = read_model(models[0])
    images = folder / "images"
    frames, missing = frames_of(model, images if images.is_dir() else folder)
    return _Instant(
        number,
        folder,
        model,
        [replace(frame, name=f"{folder.name}/{frame.name}") for frame in frames],
        [f"{folder.name}/{name}" for name in missing],
    )


def _numbered(instants: Sequence[_Instant], rate: float) -> tuple[list[Frame], list[str]]:
    """The frames with their time and camera, and the names of the cameras."""
    labels = {
        frame.name: PurePosixPath(frame.name).stem
        for instant in instants
        for frame in instant.frames
    }
    names = sorted(set(labels.values()))
    places = {name: place for place, name in enumerate(names)}
    frames = [
        replace(frame, time=instant.number / rate, camera=places[labels[frame.name]])
        for instant in instants
        for frame in instant.frames
    ]
    return frames, names
