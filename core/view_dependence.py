"""View dependence: parts of a render that files of splats do not hold."""

from __future__ import annotations

from dataclasses import replace
from math import prod

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.model import PrimitiveModel
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.splats import Sh


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


@torch.no_grad()
def decodes_colors(
    model: PrimitiveModel, camera: Cameras, time: Float[Tensor, ""] | None = None
) -> bool:
    """True if the model changes colours after rendering; false for most models.

    Colours that are not spherical harmonics do not count: no file of splats takes those of a model
    that decodes. The arguments are those of ``differs_by_view``.
    """
    if type(model).decode is PrimitiveModel.decode:
        return False
    splats = model.splats(time, camera)
    if not isinstance(splats.colors, Sh):
        return False
    shape = (1, camera.height, camera.width)  # A decoder may refuse smaller images.
    values = torch.linspace(0, 1, 3 * prod(shape), device=camera.world_to_camera.device)
    color, one = values.reshape(*shape, 3), values.new_ones(*shape, 1)
    rendered = RenderOutput(
        color,
        one,
        RenderStatistics.zeros(splats.means, 1, frozenset()),
        depth=one,
        extra=None if splats.extra is None else one * splats.extra.mean(dim=0),
    )
    return not torch.equal(model.decode(rendered, camera).color, color)


def lacking_in_files(
    model: PrimitiveModel, camera: Cameras, time: Float[Tensor, ""] | None = None
) -> tuple[str, ...]:
    """Names of the properties of a model that files of splats do not hold; none for most models.

    The names are figures of a finished run. The arguments are those of ``differs_by_view``.
    """
    lacks = {"depends_on_view": differs_by_view, "decodes_colors": decodes_colors}
    return tuple(name for name, is_lacking in lacks.items() if is_lacking(model, camera, time))
