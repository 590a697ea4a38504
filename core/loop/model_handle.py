"""ModelHandle: read-only access of callbacks to the model while it trains."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.loop.evaluation import render_model
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats


class ModelHandle:
    """Renders the current model, or returns its splats; has no cost without a call."""

    def __init__(
        self, model: PrimitiveModel, rasterizer: Rasterizer, settings: RenderSettings
    ) -> None:
        """Give access to these; a callback must not change them."""
        self.model, self.rasterizer, self.settings = model, rasterizer, settings

    @torch.no_grad()
    def splats(self, time: Float[Tensor, ""] | None = None) -> Splats:
        """The splats at ``time`` in [0, 1] without a view; must not be changed in place.

        They are in the scene frame.
        """
        return self.model.splats(time).map(Tensor.detach)

    def render(self, cameras: Cameras, time: Float[Tensor, ""] | None = None) -> RenderOutput:
        """Render from any cameras, with the settings and the background of the evaluation."""
        return render_model(self.model, self.rasterizer, cameras, self.settings, time)
