"""ShownModel: a model as a page wants it: cropped, with smaller Gaussians, or fewer bands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column
from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE
from gsfw.core.model import PrimitiveModel
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Sh, Splats
from gsfw.viewer.view_state import Box, ViewState


class ShownModel(PrimitiveModel):
    """Another model, whose splats are edited on their way to the rasterizer; it does not change."""

    def __init__(self, given: PrimitiveModel, state: ViewState, to_crop: Similarity | None) -> None:
        """Show ``given`` with the crop, scale and degree of ``state``."""
        super().__init__()
        self.depends_on_view = given.depends_on_view
        self._given, self._state, self._to_crop = given, state, to_crop

    def columns(self) -> Mapping[str, Column]:
        """The columns of the model."""
        return self._given.columns()

    def temporal_columns(self) -> Mapping[str, Column]:
        """The temporal columns of the model."""
        return self._given.temporal_columns()

    def active_bands(self) -> int | None:
        """The active bands of the model."""
        return self._given.active_bands()

    @torch.no_grad()
    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The edited splats of the model."""
        return edited(self._given.splats(time, cameras), self._state, self._to_crop)

    def decode(self, output: RenderOutput, cameras: Cameras) -> RenderOutput:
        """Decode as the model does."""
        return self._given.decode(output, cameras)


def shown(
    model: PrimitiveModel, state: ViewState, to_crop: Similarity | None = None
) -> PrimitiveModel:
    """The model as a page wants it; itself where the page changes nothing about its splats.

    Args:
        model: the model.
        state: of the page.
        to_crop: leads to the frame of the crop box; ``None``: that of the model.
    """
    changes = state.crop is not None or state.splat_scale != 1.0 or state.sh_degree < MAX_DEGREE
    return ShownModel(model, state, to_crop) if changes else model


def edited(splats: Splats, state: ViewState, to_crop: Similarity | None = None) -> Splats:
    """The splats with the crop, scale and degree of ``state``; see ``shown``."""
    if state.crop is not None:
        means = splats.means
        if to_crop is not None:
            means = to_crop.apply(means.cpu()).to(means)
        kept = inside(means, state.crop).nonzero()[:, 0]
        splats = splats.take(kept)
        splats = replace(splats, rows=kept) if splats.rows is None else splats
    if isinstance(splats.colors, Sh) and state.sh_degree < splats.colors.degree:
        splats = replace(splats, colors=replace(splats.colors, degree=state.sh_degree))
    factor = state.splat_scale
    if factor == 1.0:
        return splats
    if splats.scales is not None:
        return replace(splats, scales=splats.scales * factor)
    assert splats.covariances is not None
    return replace(splats, covariances=splats.covariances * factor**2)


def inside(means: Float[Tensor, "n 3"], box: Box) -> Bool[Tensor, " n"]:
    """True for centres in the box."""
    low, high = means.new_tensor(box.low), means.new_tensor(box.high)
    return ((means >= low) & (means <= high)).all(1)
