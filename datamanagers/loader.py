"""Loader: batches of a data set's images, on any device."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from gsfw.core.batch import Batch, ViewMap
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split, Views
from gsfw.datamanagers.device_images import (
    DeviceImages,
    PlacedImage,
    Upload,
    staying,
    upload_to,
)
from gsfw.datamanagers.fitted_map import enlarged
from gsfw.datamanagers.image_cache import ImageCache


class Loader:
    """Puts images, cameras and masks together; on a GPU nothing here waits for it.

    Images cross to a GPU as 8-bit numbers, and become floating-point ones there.
    """

    def __init__(
        self,
        views: Mapping[Split, Views],
        cache: ImageCache,
        gpu_budget: int = 0,
        way_to: Callable[[torch.device], Upload | None] = upload_to,
    ) -> None:
        """Nothing is decoded yet.

        Args:
            views: of every split.
            cache: of all images, numbered as ``numbers`` has them.
            gpu_budget: bytes of a GPU that images may stay in.
            way_to: how images get to a device.
        """
        self._views = views
        self._cache = cache
        self._budget = gpu_budget
        self._way_to = way_to
        self._kept = staying(cache.sizes, gpu_budget)
        self._there: DeviceImages | None = None
        self._cameras: dict[Split, list[Cameras]] = {}
        self._device = torch.device("cpu")

    def number(self, split: Split, index: int) -> int:
        """The number of a view's image: those that are trained on come first."""
        return index if split is Split.TRAIN else len(self._views[Split.TRAIN]) + index

    def notes(self) -> tuple[str, ...]:
        """Number of images that stay on the GPU, if not all do."""
        total = len(self._cache.sizes)
        if self._budget == 0 or len(self._kept) == total:
            return ()
        return (
            f"{len(self._kept)} of {total} images stay on the GPU "
            f"(gpu_cache_mb={self._budget // 1_000_000}), the others are copied to it for each use",
        )

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:
        """Start decoding, and sending to the device of the latest ``load``."""
        numbers = [self.number(split, index) for index in indices]
        if self._there is None:
            self._cache.prefetch(numbers)
            return
        for number, image in self._cache.prefetch(self._there.lacking(numbers)).items():
            self._there.send(number, image)

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Batches; the same images whatever was cached, decoded or sent ahead.

        Raises:
            DataError: an image does not decode.
        """
        self._move_to(device)
        return [self._batch(split, group) for group in self._views[split].groups(indices)]

    def _move_to(self, device: torch.device) -> None:
        """Load for this device from now on."""
        if self._cameras and device == self._device:
            return
        if self._there is not None:
            self._there.close()
        upload = self._way_to(device)
        self._device = device
        self._there = (
            None if upload is None else DeviceImages(self._cache.request, upload, self._kept)
        )
        # All of them at once: to copy the few of each step would let the host wait in each step.
        self._cameras = {
            split: [camera.to(device) for camera in views.cameras]
            for split, views in self._views.items()
        }

    def _batch(self, split: Split, group: tuple[int, ...]) -> Batch:
        cameras = [self._cameras[split][index] for index in group]
        images = [self._image(self.number(split, index)) for index in group]
        pixels = _pixels(images) / 255
        opaque = pixels.shape[3] == 3
        return Batch(
            images=pixels if opaque else pixels[..., :3],
            cameras=cameras[0] if len(cameras) == 1 else Cameras.cat(cameras),
            views=group,
            alpha=None if opaque else pixels[..., 3:],
            mask=_mask(images),
            maps=_maps(images),
        )

    def _image(self, number: int) -> PlacedImage:
        if self._there is None:
            return PlacedImage.on_host(self._cache.get(number))
        return self._there.get(number)

    def drop_images(self) -> int:
        """Halve the budget of images in main memory; returns the number of freed bytes."""
        return self._cache.halve()

    def close(self) -> None:
        """Stop decoding and sending, and free the images."""
        self._cache.close()
        if self._there is not None:
            self._there.close()


def _pixels(images: list[PlacedImage]) -> UInt8[Tensor, "c h w d"]:
    """Colours, and alpha where any image has it: the others are opaque."""
    channels = max(image.pixels.shape[2] for image in images)
    return torch.stack([_with_channels(image.pixels, channels) for image in images])


def _with_channels(pixels: UInt8[Tensor, "h w d"], channels: int) -> UInt8[Tensor, "h w e"]:
    if pixels.shape[2] == channels:
        return pixels
    return torch.cat([pixels, torch.full_like(pixels[..., :1], 255)], dim=2)


def _maps(images: list[PlacedImage]) -> dict[str, ViewMap]:
    """Per-view maps, enlarged to the size of the images where they are smaller."""
    found = {}
    for name, first in images[0].maps.items():
        height, width = first.known.shape
        known = torch.stack([image.maps[name].known for image in images])[..., None]
        values = [
            enlarged(image.maps[name].values.float(), first.rule, width, height) for image in images
        ]
        found[name] = ViewMap(torch.stack(values) * known, known, first.rule)
    return found


def _mask(images: list[PlacedImage]) -> Bool[Tensor, "c h w 1"] | None:
    """Valid pixels; all are valid in an image without a mask."""
    if all(image.mask is None for image in images):
        return None
    masks = [
        torch.ones_like(image.pixels[..., 0], dtype=torch.bool)
        if image.mask is None
        else image.mask
        for image in images
    ]
    return torch.stack(masks)[..., None]
