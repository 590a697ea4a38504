"""MovingRegion: the pixels of an image that change over time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split

MIN_DEVIATION = 0.02
"""Least standard deviation over time of a moving pixel, of colours in [0, 1]: 5 of 255 levels,
well above the noise of rendered and of compressed images (measured: below 2 levels)."""

FROM_MASKS = "masks of the data set"
FROM_VARIANCE = "temporal variance of all images of the same fixed camera"
UNKNOWN = "not available: the camera shows no other time, and the data set has no mask"


@dataclass(frozen=True)
class MovingRegion:
    """The moving pixels of one view."""

    mask: Bool[Tensor, "h w 1"] | None
    """True where the scene moves; ``None`` if unknown."""
    source: str
    """``FROM_MASKS``, ``FROM_VARIANCE`` or ``UNKNOWN``."""


def camera_key(camera: Cameras) -> tuple[object, ...]:
    """Key of the views of one static camera: pose, lens and image size.

    It is not the ``camera_index``: a hand-held camera has one index too.
    """
    pose, lens = (
        tuple(matrix.flatten().tolist()) for matrix in (camera.world_to_camera, camera.intrinsics)
    )
    return pose, lens, camera.width, camera.height, camera.model


def views_of_cameras(cameras: Sequence[Cameras]) -> dict[object, list[int]]:
    """Indices of the views of each fixed camera, by its key."""
    found: dict[object, list[int]] = {}
    for index, camera in enumerate(cameras):
        found.setdefault(camera_key(camera), []).append(index)
    return found


class MovingRegions:
    """The moving region of every view of a split; computed on first use."""

    def __init__(
        self,
        data: DataManager,
        split: Split,
        background: Float[Tensor, " 3"],
        device: torch.device,
    ) -> None:
        """Store the arguments; decodes nothing.

        Args:
            data: its views have times.
            split: split to be evaluated.
            background: background of images with alpha.
            device: device of the comparison.
        """
        self._data, self._split = data, split
        self._background, self._device = background, device
        self._members: dict[object, list[tuple[Split, int]]] = {}
        for part in Split:
            for key, indices in views_of_cameras(data.views(part).cameras).items():
                self._members.setdefault(key, []).extend((part, index) for index in indices)
        self._varying: dict[object, Tensor | None] = {}
        self._sources: Counter[str] = Counter()
        self._shares: list[float] = []

    def find(self, index: int) -> MovingRegion:
        """The region of a view: from the data set's mask, else by variance, else unknown."""
        region = self._find(index)
        self._sources[region.source] += 1
        if region.mask is not None:
            self._shares.append(float(region.mask.double().mean()))
        return region

    def sources(self) -> str:
        """Sources of the regions so far, for result files."""
        if len(self._sources) == 1:
            found = next(iter(self._sources))
        else:
            found = "; ".join(f"{count} views: {name}" for name, count in self._sources.items())
        if not self._shares:
            return found
        return f"{found} ({sum(self._shares) / len(self._shares):.1%} of the pixels)"

    def _find(self, index: int) -> MovingRegion:
        mask = self._data.moving_mask(self._split, index)
        if mask is not None:
            return MovingRegion(mask.to(self._device), FROM_MASKS)
        key = camera_key(self._data.views(self._split).cameras[index])
        if key not in self._varying:
            self._varying[key] = self._variance(self._members[key])
        varying = self._varying[key]
        return MovingRegion(varying, UNKNOWN if varying is None else FROM_VARIANCE)

    def _variance(self, members: Sequence[tuple[Split, int]]) -> Bool[Tensor, "h w 1"] | None:
        """Pixels that vary over the images of one static camera; ``None`` for a single time.

        Training images are included: they show the motion, not the quality of a render.
        """
        times = {self._time(part, index) for part, index in members}
        if len(times) < 2:
            return None
        total, squares = None, None
        for part, index in members:
            (batch,) = self._data.load(part, [index], self._device)
            image = batch.target(self._background)[0].double()
            total = image if total is None else total + image
            squares = image**2 if squares is None else squares + image**2
        assert total is not None
        assert squares is not None
        variance = squares / len(members) - (total / len(members)) ** 2
        return variance.amax(dim=-1, keepdim=True) > MIN_DEVIATION**2

    def _time(self, part: Split, index: int) -> float | None:
        time = self._data.views(part).cameras[index].time
        return None if time is None else float(time[0])
