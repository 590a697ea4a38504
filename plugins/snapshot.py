"""Snapshot: the splats of a model at one time for a splat file, in the world of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.frame import transform_splats, with_axes
from gsfw.core.maths.spherical_harmonics import rgb_to_dc
from gsfw.core.model import PrimitiveModel
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.core.view_dependence import lacking_in_files

CHUNK = 1 << 16
"""Rows whose values are checked at once."""
LOOKS_DIFFERENT = (
    "and may look different from renders of the model. A model file has all: format=gsfw"
)
NOTES = {
    "depends_on_view": "the splats of this model depend on the view: a file of splats has those "
    f"without a view, {LOOKS_DIFFERENT}",
    "decodes_colors": "this model changes colours after rendering: a file of splats has those "
    f"before, {LOOKS_DIFFERENT}",
}
"""Warnings on files of splats, by the figure of a finished run that asks for them."""


@torch.no_grad()
def snapshot(
    model: PrimitiveModel,
    scene: Scene,
    antialiased: bool,
    time: Float[Tensor, ""] | None = None,
    edit: Callable[[Splats], Splats] | None = None,
) -> SplatFile:
    """The model's splats at ``time``, moved back to the world of the data, float64 on the CPU.

    Splats with covariances get quaternions and scales. Three channels that the model does not
    decode are colours, and become the constant SH coefficient. Rows that are not finite are left
    out, and counted. Colours may share memory with the model, which is not to be trained on
    meanwhile.

    Args:
        model: source of the splats.
        scene: has the transform to the world of the data.
        antialiased: true if the file shall request a render with antialiasing.
        time: in [0, 1]; a static model ignores it.
        edit: edit of the splats before, in the scene frame; ``None`` for none.
    """
    splats = model.splats(time)
    if type(model).decode is PrimitiveModel.decode:
        splats = with_sh(splats)
    splats = splats if edit is None else edit(splats)
    splats = splats.map(Tensor.detach)
    world = transform_splats(replace(splats.to("cpu"), rows=None), scene.world_from_scene)
    finite = _finite_rows(world)
    kept = finite.nonzero()[:, 0]
    num_dropped = len(finite) - len(kept)
    return SplatFile(
        with_axes(world.take(kept) if num_dropped else world),  # No copy where all are kept.
        antialiased=antialiased,
        up=scene.up,
        num_dropped=num_dropped,
    )


def view_notes(
    model: PrimitiveModel, camera: Cameras, time: Float[Tensor, ""] | None = None
) -> list[str]:
    """Warnings if renders of the model differ from those of ``snapshot``; empty for most models.

    The arguments are those of ``differs_by_view``.
    """
    return [NOTES[name] for name in lacking_in_files(model, camera, time)]


def with_sh(splats: Splats) -> Splats:
    """The same splats, with three channels as SH colours of degree 0, which clamps them at 0."""
    if isinstance(splats.colors, Sh) or splats.channels != 3:
        return splats
    return replace(splats, colors=Sh(rgb_to_dc(splats.colors)[:, None], 0))


def _finite_rows(splats: Splats) -> Bool[Tensor, " n"]:
    """True for the splats whose values are all finite."""
    finite = torch.ones(len(splats), dtype=torch.bool)
    for tensor in splats.tensors().values():
        parts = tensor.flatten(1).split(CHUNK) if tensor.dim() > 1 else tensor[:, None].split(CHUNK)
        for part, kept in zip(parts, finite.split(CHUNK), strict=True):
            kept.logical_and_(part.isfinite().all(1))
    return finite
