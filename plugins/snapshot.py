"""Snapshot: a model at one time as a splat file holds it, in the world of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.exchange import SplatFile
from gsfw.core.maths.frame import transform_splats, with_axes
from gsfw.core.model import PrimitiveModel
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats


@dataclass(frozen=True)
class Snapshot:
    """What an exporter is given, and what was left out of it."""

    content: SplatFile
    num_dropped: int
    """Rows that were not finite."""


@torch.no_grad()
def snapshot(
    model: PrimitiveModel,
    scene: Scene,
    antialiased: bool,
    time: Float[Tensor, ""] | None = None,
    edit: Callable[[Splats], Splats] | None = None,
) -> Snapshot:
    """The model's splats at ``time``, moved back to the world of the data, float64 on the CPU.

    Splats that a model gives by covariances get quaternions and scales.

    Args:
        model: whose splats are taken.
        scene: that says where the world of the data is.
        antialiased: whether the file shall say that it is to be drawn with antialiasing.
        time: in [0, 1]; a static model ignores it.
        edit: what is done to the splats before, in the scene frame; ``None`` for nothing.
    """
    splats = model.splats(time)
    splats = splats if edit is None else edit(splats)
    world = transform_splats(replace(splats.to("cpu"), rows=None), scene.world_from_scene)
    finite = torch.stack(
        [tensor.flatten(1).isfinite().all(1) for tensor in _by_row(world)], dim=1
    ).all(1)
    kept = finite.nonzero()[:, 0]
    content = SplatFile(with_axes(world.take(kept)), antialiased=antialiased, up=scene.up)
    return Snapshot(content, len(finite) - len(kept))


def _by_row(splats: Splats) -> list[Tensor]:
    return [tensor.reshape(len(splats), -1) for tensor in splats.tensors().values()]
