"""Shot: one camera's view of a model, from which channels are made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Splats
from gsfw.rendering.gaussian_values import view_depths
from gsfw.rendering.normals import NAN

LEAST_COVERAGE = 0.5
"""Pixels that Gaussians cover less than this show no surface, and have no value."""


@dataclass(frozen=True)
class Shot:
    """One camera's view of a model, and the passes that its channels share."""

    model: PrimitiveModel
    """On the device of the camera."""
    rasterizer: Rasterizer
    """Any backend."""
    camera: Cameras
    """One camera."""
    settings: RenderSettings
    """Conventions of the render."""
    time: Float[Tensor, ""] | None = None
    """In [0, 1]; ``None`` for a static capture."""
    target: Float[Tensor, "h w 3"] | None = None
    """The photo, over the background; only for channels that compare with it."""
    valid: Bool[Tensor, "h w 1"] | None = None
    """True for pixels that are compared; ``None`` for all."""
    has_surface: bool = False
    """True if the pass of the colours renders the depth image too."""

    @property
    def has_depth(self) -> bool:
        """True if the rasterizer renders depth in the pass of the colours."""
        return Feature.DEPTH in self.rasterizer.capabilities().features

    @cached_property
    def output(self) -> RenderOutput:
        """The colours, and the depth if wanted."""
        kind = Depth.EXPECTED if self.has_surface and self.has_depth else Depth.NONE
        settings = replace(
            self.settings, depth=kind, statistics=frozenset(), contribution_weights=None
        )
        output = self.rasterizer.render(self.splats, self.camera, settings)
        return self.model.decode(output, self.camera)

    @cached_property
    def splats(self) -> Splats:
        """The Gaussians of this view."""
        return self.model.splats(self.time, self.camera)

    @cached_property
    def depth(self) -> Float[Tensor, "h w"]:
        """View depth of the surface; NaN where there is none."""
        if not self.has_depth:
            return self.mean(view_depths(self.splats, self.camera))
        depth = self.output.depth
        assert depth is not None, "it was asked for"
        return torch.where(self.output.alpha[0, ..., 0] >= LEAST_COVERAGE, depth[0, ..., 0], NAN)

    def mean(self, values: Float[Tensor, " n"]) -> Float[Tensor, "h w"]:
        """The mean of a value of the Gaussians over those that a pixel shows, by weight."""
        blended = self.blend(values, self.settings).color[0]
        weight = blended[..., 1]
        return torch.where(weight >= LEAST_COVERAGE, blended[..., 0] / weight, NAN)

    def blend(self, values: Float[Tensor, " n"], settings: RenderSettings) -> RenderOutput:
        """Blend a value of each Gaussian, a 1 and a 0 in place of its colour, over zeros."""
        # Three channels are no slower than one: every backend compiles them for images.
        one = torch.ones_like(values)
        colors = torch.stack([values, one, torch.zeros_like(values)], dim=1)
        splats = replace(self.splats, colors=colors, extra=None)
        plain = replace(
            settings, background=None, depth=Depth.NONE, statistics=frozenset(),
            contribution_weights=None,
        )  # fmt: skip
        return self.rasterizer.render(splats, self.camera, plain)
