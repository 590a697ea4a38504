"""View dependence: a comparison of the splats of a view with those that files of splats hold."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.model import PrimitiveModel


@torch.no_grad()
def differs_by_view(
    model: PrimitiveModel, camera: Cameras, time: Float[Tensor, ""] | None = None
) -> bool:
    """True if the splats of a view differ from those without a view; false for most models.

    Extra channels may differ: no file of splats holds them.

    Args:
        model: source of the splats.
        camera: a view, in the scene frame, on the device of the model.
        time: in [0, 1]; a static model ignores it.
    """
    if not model.depends_on_view:
        return False
    found = [model.splats(time, seen) for seen in (None, camera)]
    alone, seen = (replace(splats, extra=None, rows=None).tensors() for splats in found)
    return alone.keys() != seen.keys() or any(
        not torch.equal(alone[name], seen[name]) for name in alone
    )
