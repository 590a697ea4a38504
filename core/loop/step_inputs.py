"""StepInputs: the inputs of a step that differ from step to step."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.batch import Batch, ViewMap
from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings


@dataclass(frozen=True)
class StepInputs:
    """The batches of a step, each with its settings, and the learning rates."""

    batches: Sequence[Batch]
    settings: Sequence[RenderSettings]
    """The settings of each batch."""
    rates: Float64[Tensor, " g"] | None = None
    """Learning rates by column and group, where they are on the device."""

    def tensors(self) -> list[Tensor]:
        """All tensors of the batches, and the backgrounds; in the same order each time."""
        found = [tensor for batch in self.batches for tensor in _tensors(batch)]
        backgrounds = (settings.background for settings in self.settings)
        return [*found, *(tensor for tensor in backgrounds if tensor is not None)]

    def copied(self) -> StepInputs:
        """The same in memory of its own."""
        settings = [replace(one, background=_copy_of(one.background)) for one in self.settings]
        return StepInputs([_copied(batch) for batch in self.batches], settings)

    def kind(self) -> Hashable:
        """The properties that all steps of one graph share."""
        shapes = tuple((tensor.shape, tensor.dtype) for tensor in self.tensors())
        settings = tuple(replace(one, background=None) for one in self.settings)
        return shapes, tuple(_kind(batch) for batch in self.batches), settings


def _tensors(batch: Batch) -> list[Tensor]:
    cameras = batch.cameras
    found = (batch.images, batch.alpha, batch.mask, batch.numbers, cameras.world_to_camera)
    others = (cameras.intrinsics, cameras.time, cameras.camera_index)
    maps = (tensor for item in batch.maps.values() for tensor in (item.values, item.known))
    return [tensor for tensor in (*found, *others, *maps) if tensor is not None]


def _kind(batch: Batch) -> Hashable:
    cameras, maps = batch.cameras, tuple((name, item.rule) for name, item in batch.maps.items())
    present = (batch.alpha is None, batch.mask is None, batch.mask_mode, cameras.time is None)
    return present, maps, cameras.model, cameras.width, cameras.height


def _copied(batch: Batch) -> Batch:
    maps = {
        name: ViewMap(_copy(item.values), _copy(item.known), item.rule)
        for name, item in batch.maps.items()
    }
    return replace(
        batch,
        images=_copy(batch.images),
        cameras=_copied_cameras(batch.cameras),
        alpha=_copy_of(batch.alpha),
        mask=_copy_of(batch.mask),
        numbers=_copy_of(batch.numbers),
        maps=maps,
    )


def _copied_cameras(cameras: Cameras) -> Cameras:
    return replace(
        cameras,
        world_to_camera=_copy(cameras.world_to_camera),
        intrinsics=_copy(cameras.intrinsics),
        time=_copy_of(cameras.time),
        camera_index=_copy_of(cameras.camera_index),
    )


def _copy(tensor: Tensor) -> Tensor:
    return tensor.clone(memory_format=torch.contiguous_format)


def _copy_of(tensor: Tensor | None) -> Tensor | None:
    return None if tensor is None else _copy(tensor)
