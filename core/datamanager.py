"""DataManager: where images, cameras, points and times come from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import ClassVar

import torch
from jaxtyping import Bool
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.scene import Scene


class Split(Enum):
    """Which part of a data set."""

    TRAIN = "train"
    EVAL = "eval"


@dataclass(frozen=True)
class Views:
    """The views of one split, without their pictures."""

    names: tuple[str, ...]
    """Image names, for messages and result files; unique within the split."""
    cameras: tuple[Cameras, ...]
    """One camera (c = 1) per view: sizes and models may differ between views."""
    origin: str = ""
    """How the views came into this split ("every 8th by name"); empty when nobody said."""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def times(self) -> tuple[float, ...] | None:
        """Time of each view in [0, 1]; ``None`` for a static capture."""
        if any(camera.time is None for camera in self.cameras):
            return None
        return tuple(float(camera.time[0]) for camera in self.cameras if camera.time is not None)

    def groups(self, indices: Sequence[int]) -> list[tuple[int, ...]]:
        """Split ``indices`` into runs that may share a batch: one time, one size, one model."""
        grouped: dict[tuple[object, ...], list[int]] = {}
        for index in indices:
            camera = self.cameras[index]
            time = None if camera.time is None else float(camera.time[0])
            key = (time, camera.width, camera.height, camera.model)
            grouped.setdefault(key, []).append(index)
        return [tuple(group) for group in grouped.values()]


@dataclass(frozen=True)
class DataRequest:
    """What a run asks of its data, whatever its format."""

    path: Path | None
    """The ``data`` key; ``None`` for data that needs no file."""
    downscale: float = 1.0
    """Images are shrunk by this factor (area filter, size rounded); >= 1."""
    eval_every_nth: int = 8
    """Every n-th image by name is held out, unless the data set brings its own split; 0: none."""
    eval_names: tuple[str, ...] = ()
    """Names of the images to hold out, instead of every n-th."""
    cache_megabytes: int = 2048
    """Memory that decoded images (uint8) may take."""
    gpu_cache_megabytes: int = 0
    """Memory of the GPU that decoded images (uint8) may stay in; 0 where none is used."""


class DataManager(ABC):
    """Where images, cameras, points and times come from."""

    has_pictures: ClassVar[bool] = True
    """Whether there is anything to ``load``; a model file brings cameras alone."""

    @property
    @abstractmethod
    def scene(self) -> Scene:
        """What is known of the capture before training."""

    @abstractmethod
    def views(self, split: Split) -> Views:
        """The views of a split, without decoding a picture."""

    @abstractmethod
    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Decode views into batches, one for each of ``views(split).groups(indices)``.

        Raises:
            DataError: a picture does not decode or contradicts its camera.
        """

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """Where something moves in a view's picture, on the CPU; evaluation looks at it apart.

        ``None`` when the data set does not say.

        Raises:
            DataError: the mask does not decode or does not fit its picture.
        """
        return None

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:  # noqa: B027
        """Start decoding views that will probably be asked for next; may do nothing."""

    def notes(self) -> tuple[str, ...]:
        """What the user should know of this data: how it was recognised, what was skipped."""
        return ()

    def close(self) -> None:  # noqa: B027
        """Stop background work and free the cache."""
