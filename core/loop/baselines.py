"""Baselines: PSNR of images that need no model; a result has to beat them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.datamanager import DataManager, Split, spread
from gsfw.core.metrics import psnr
from gsfw.core.progress import tracked
from gsfw.core.temporal_metrics.moving_region import camera_key, views_of_cameras
from gsfw.core.temporal_metrics.over_time import MOVING, means

MOST_IMAGES = 16
"""Most training images that a baseline is made of, spread evenly over the views or over time."""

CONSTANT, MEAN_IMAGE, STILL = "constant", "mean_image", "still"

PROTOCOL = {
    CONSTANT: "the single colour with the highest PSNR on the training images: their mean, or the "
    "background",
    MEAN_IMAGE: "the mean of the training images of the same size",
    STILL: "the mean over time of the training images of the same fixed camera",
}
"""Definitions of the baselines, each made of at most ``MOST_IMAGES`` training images."""

NAMES = {
    "constant_psnr": "one colour",
    "mean_image_psnr": "the mean image",
    "still_psnr": "a still image",
}
"""Their PSNR in result files, and their names for people."""

NO_STILL = "not available: no fixed camera has both training and held-out images"


class Baselines:
    """PSNR of a constant colour, of a mean image and of an image that stands still.

    They are independent of the model: they are measured during the evaluations of a run, on the
    images that these load anyway, and kept: each view once.
    """

    def __init__(
        self,
        data: DataManager,
        split: Split,
        background: Float[Tensor, " 3"],
        device: torch.device,
    ) -> None:
        """Decodes nothing.

        Args:
            data: source of the images.
            split: split to be evaluated.
            background: background of images with alpha.
            device: device of the comparison.
        """
        self._data, self._split = data, split
        self._background, self._device = background, device
        self._views = data.views(split).cameras
        self._per_view: dict[int, dict[str, float]] = {}
        self._constant: Tensor | None = None
        self._mean_images: dict[tuple[int, ...], Tensor] = {}
        self._still: tuple[object, Tensor | None] = (None, None)

    def compare(
        self,
        index: int,
        target: Float[Tensor, "h w 3"],
        valid: Bool[Tensor, "h w 1"] | None,
        moving: Bool[Tensor, "h w 1"] | None,
    ) -> None:
        """Compare the baselines with an image of the split; nothing if that is known.

        Args:
            index: index of the view.
            target: its image.
            valid: its valid pixels; ``None`` for all.
            moving: its moving and valid pixels; ``None`` for a static capture or if unknown.
        """
        if index in self._per_view:
            return
        if self._constant is None:
            self._find_means()
        assert self._constant is not None
        images = {
            CONSTANT: self._constant.expand_as(target),
            MEAN_IMAGE: self._mean_images.get(tuple(target.shape)),
            STILL: self._still_image(index),
        }
        found: dict[str, float] = {}
        for name, image in images.items():
            if image is None:
                continue
            found[f"{name}_psnr"] = psnr(image, target, valid)
            if moving is not None and name != MEAN_IMAGE and bool(moving.any()):
                found[f"{name}_{MOVING}psnr"] = psnr(image, target, moving)
        self._per_view[index] = found
        if len(self._per_view) == len(self._views):
            self._mean_images, self._still = {}, (None, None)

    def figures(self) -> Mapping[str, float]:
        """PSNR of each baseline in dB: the mean over the views compared so far."""
        return means(tuple(self._per_view.values()))

    def document(self) -> dict[str, Any]:
        """Figures and definitions, as plain data for result files; empty without images."""
        figures = self.figures()
        if not figures:
            return {}
        known = {name: text for name, text in PROTOCOL.items() if f"{name}_psnr" in figures}
        if self._data.scene.is_dynamic and STILL not in known:
            known[STILL] = NO_STILL
        return {**figures, **known}

    def _find_means(self) -> None:
        """Find the best colour and the mean images, in one pass over some training images."""
        sums: dict[tuple[int, ...], list[Tensor]] = {}
        moments: list[tuple[Tensor, Tensor]] = []
        chosen = spread(range(len(self._data.views(Split.TRAIN))), MOST_IMAGES)
        for index in tracked(chosen, "measuring baselines", len(chosen)):
            image, weights = self._training_image(index)
            count = weights.sum().clamp_min(1.0)
            moments.append(
                ((image * weights).sum((0, 1)) / count, (image**2 * weights).sum((0, 1)) / count)
            )
            total = sums.setdefault(tuple(image.shape), [torch.zeros_like(image), weights * 0])
            total[0] += image * weights
            total[1] += weights
        first, second = (torch.stack(values) for values in zip(*moments, strict=True))
        self._constant = best_constant(first, second, self._background)
        self._mean_images = {
            shape: self._mean(total, weights) for shape, (total, weights) in sums.items()
        }

    def _still_image(self, index: int) -> Tensor | None:
        """The mean over time of a fixed camera's training images; ``None`` if it has none.

        Only the latest one is kept: evaluations go camera by camera.
        """
        if not self._data.scene.is_dynamic:
            return None
        key = camera_key(self._views[index])
        if self._still[0] != key:
            sums: list[Tensor] = []
            for member in spread(self._members.get(key, []), MOST_IMAGES):
                image, weights = self._training_image(member)
                added = [image * weights, weights]
                sums = [x + y for x, y in zip(sums, added, strict=True)] if sums else added
            self._still = (key, self._mean(*sums) if sums else None)
        return self._still[1]

    @cached_property
    def _members(self) -> dict[object, list[int]]:
        """Training views of each fixed camera."""
        return views_of_cameras(self._data.views(Split.TRAIN).cameras)

    def _training_image(self, index: int) -> tuple[Float[Tensor, "h w 3"], Float[Tensor, "h w 1"]]:
        """A training image, and 1 where it is valid."""
        (batch,) = self._data.load(Split.TRAIN, [index], self._device)
        image = batch.target(self._background)[0].clamp(0, 1)
        valid = torch.ones_like(image[..., :1]) if batch.valid is None else batch.valid[0]
        return image, valid.to(image.dtype)

    def _mean(
        self, total: Float[Tensor, "h w 3"], weights: Float[Tensor, "h w 1"]
    ) -> Float[Tensor, "h w 3"]:
        """The mean image; the constant colour where no image is valid."""
        assert self._constant is not None
        return torch.where(weights > 0, total / weights.clamp_min(1.0), self._constant)


def best_constant(
    first: Float[Tensor, "k 3"], second: Float[Tensor, "k 3"], background: Float[Tensor, " 3"]
) -> Float[Tensor, " 3"]:
    """The colour with the highest mean PSNR over some images: their mean, or the background.

    The mean has the least squared error. The mean of several PSNRs can favour the background: it
    is exact where an image shows nothing else.

    Args:
        first: mean colour of each image.
        second: mean of the squared colours of each image.
        background: background of images with alpha.
    """
    candidates = torch.stack([first.mean(0), background.clamp(0, 1).to(first)]).double()
    errors = second - 2 * candidates[:, None] * first + candidates[:, None] ** 2
    error = errors.mean(-1).clamp_min(1e-10)
    best = int((-10.0 * error.log10()).mean(-1).argmax())
    return candidates[best].to(first.dtype)
