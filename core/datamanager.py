"""DataManager: the source of images, cameras, points and times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from statistics import median
from typing import ClassVar

import torch
from jaxtyping import Bool
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.hold_out import HoldOutBy
from gsfw.core.scene import Scene


class Split(Enum):
    """Part of a data set."""

    TRAIN = "train"
    """The views of the loss."""
    EVAL = "eval"
    """The held-out views, for evaluation only."""


def spread(items: Sequence[int], most: int) -> Sequence[int]:
    """At most ``most`` of the items, evenly spread from first to last, in their order; 0: all."""
    if most <= 0 or len(items) <= most:
        return items
    return [items[place * (len(items) - 1) // max(most - 1, 1)] for place in range(most)]


@dataclass(frozen=True)
class Views:
    """The views of one split, without their images."""

    names: tuple[str, ...]
    """Image names, for messages and result files; unique within the split."""
    cameras: tuple[Cameras, ...]
    """One camera (c = 1) per view: sizes and models may differ between views."""
    origin: str = ""
    """Rule that selected the views of this split ("every 8th by name"); empty when unknown."""
    maps: Mapping[str, int] = field(default_factory=dict)
    """Number of channels of each per-view map, by name; every batch has these maps. A method that
    needs one checks it before training."""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def times(self) -> tuple[float, ...] | None:
        """Time of each view in [0, 1]; ``None`` for a static capture."""
        if any(camera.time is None for camera in self.cameras):
            return None
        return tuple(float(camera.time[0]) for camera in self.cameras if camera.time is not None)

    @property
    def pixels(self) -> int:
        """Pixels of a view, as a median; 0 without views."""
        return int(median([camera.width * camera.height for camera in self.cameras] or [0]))

    def groups(self, indices: Sequence[int]) -> list[tuple[int, ...]]:
        """Split ``indices`` into runs that may share a batch: one time, one size, one model.

        Groups of most views come first, then those of the smallest images, so that steps with the
        same numbers and sizes of images have them in the same order.
        """
        grouped: dict[tuple[float | None, int, int, CameraModel], list[int]] = {}
        for index in indices:
            camera = self.cameras[index]
            time = None if camera.time is None else float(camera.time[0])
            key = (time, camera.width, camera.height, camera.model)
            grouped.setdefault(key, []).append(index)
        order = sorted(grouped, key=lambda key: (-len(grouped[key]), key[1], key[2]))
        return [tuple(grouped[key]) for key in order]


@dataclass(frozen=True)
class DataRequest:
    """Settings of the run that concern data of any format."""

    path: Path | None
    """The ``data`` key; ``None`` for data that needs no file."""
    downscale: float = 1.0
    """Images are shrunk by this factor (area filter, size rounded); >= 1."""
    eval_every_nth: int = 8
    """One image of n is held out, unless the data set has its own split; 0: none."""
    eval_by: HoldOutBy = HoldOutBy.AUTO
    """The rule by which they are chosen."""
    eval_names: tuple[str, ...] = ()
    """Names of the images to hold out, instead of every n-th."""
    cache_megabytes: int = 2048
    """Memory limit of decoded images (uint8) and per-view maps."""
    gpu_cache_megabytes: int = 0
    """GPU memory limit of decoded images and per-view maps; 0 if no GPU is used."""


class DataManager(ABC):
    """The source of images, cameras, points and times.

    Per-view maps: a data manager names them with their channels in ``Views.maps``, and puts a
    ``ViewMap`` for each into every ``Batch.maps``, undistorted and at the size of the images; the
    resolution schedule shrinks them by their rule. Formats that derive from ``CaptureConfig`` only
    list files (``Frame.maps``); ``WrappedDataManager`` adds maps to any other data manager.
    """

    has_images: ClassVar[bool] = True
    """False if there are no images to ``load``: a model file holds cameras alone."""

    @property
    @abstractmethod
    def scene(self) -> Scene:
        """The facts about the capture that are known before training."""

    @abstractmethod
    def views(self, split: Split) -> Views:
        """The views of a split; decodes no image."""

    @abstractmethod
    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Decode views into batches, one for each of ``views(split).groups(indices)``.

        Raises:
            DataError: an image or a map does not decode or contradicts its camera.
        """

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """Mask of the moving pixels of a view, on the CPU, for evaluation.

        ``None`` when the data set has no such masks.

        Raises:
            DataError: the mask does not decode or does not fit its image.
        """
        return None

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:  # noqa: B027
        """Start to decode views that are likely to be loaded next; may do nothing."""

    def drop_images(self) -> int:
        """Keep half as many decoded images from now on, as memory is short; may do nothing.

        Returns:
            Bytes that are free now.
        """
        return 0

    def notes(self) -> tuple[str, ...]:
        """Notes for the user: the recognised format, and the skipped data."""
        return ()

    def close(self) -> None:  # noqa: B027
        """Stop background work and free the cache."""


class WrappedDataManager(DataManager):
    """Another data manager, all of whose members it forwards; a subclass changes some of them.

    To add a per-view map, override ``views`` (``replace(views, maps={**views.maps, NAME: d})``)
    and ``load`` (``replace(batch, maps={**batch.maps, NAME: ViewMap.of(values, rule)})``).
    """

    def __init__(self, given: DataManager) -> None:
        """Forward to ``given``."""
        self.given = given
        """The wrapped data manager."""
        self.has_images = given.has_images  # type: ignore[misc]

    @property
    def scene(self) -> Scene:
        """The scene of the wrapped data manager."""
        return self.given.scene

    def views(self, split: Split) -> Views:
        """The views of the wrapped data manager."""
        return self.given.views(split)

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """The batches of the wrapped data manager."""
        return self.given.load(split, indices, device)

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """The moving mask of the wrapped data manager."""
        return self.given.moving_mask(split, index)

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:
        """Start decoding in the wrapped data manager."""
        self.given.prefetch(split, indices)

    def drop_images(self) -> int:
        """Keep fewer images in the wrapped data manager; returns the bytes that are free now."""
        return self.given.drop_images()

    def notes(self) -> tuple[str, ...]:
        """The notes of the wrapped data manager."""
        return self.given.notes()

    def close(self) -> None:
        """Close the wrapped data manager."""
        self.given.close()
