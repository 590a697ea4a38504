"""Exposures: the colour difference between each training image and the scene, as an affine map.

As in the exposure compensation of Kerbl et al. 2024 (section "Exposure" of the hierarchical 3DGS).
Differences: only the splats' part of the colour changes, not the background behind them, and
the mean of all maps is held at the identity: else a brighter scene and darker images are the same.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsfw.core.learning_rate import LearningRate
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.render_output import RenderOutput

FEW_IMAGES = 20
"""Images up to which maps have the full learning rate; beyond, it falls with the root of their
number. Adam divides by the root mean square of a gradient that is zero in most steps, so that at
the full rate each visit would move a map by the root of that number times the rate. Measured on
200 views of the built-in scene, 1000 steps: 34.2 dB instead of 33.5 with exact colours, and
34.1 instead of 33.7 with gains of 0.7 to 1.3."""


class Exposures(nn.Module):
    """An affine map of colours for each training image; the identity at the start."""

    def __init__(self, names: tuple[str, ...], learning_rate: LearningRate) -> None:
        """Start with the identity for each image.

        Args:
            names: names of the training images.
            learning_rate: learning rate of every number of the maps of a few images.
        """
        super().__init__()
        self.names = names
        self.learning_rate = learning_rate
        self.changes = nn.Parameter(torch.zeros(len(names), 3, 4))
        """[v, 3, 4]: each map less the identity; gains of colours, then an offset."""

    def group(self) -> ParameterGroup:
        """Parameter group for the optimizer."""
        rate = self.learning_rate.times(math.sqrt(FEW_IMAGES / max(len(self.names), FEW_IMAGES)))
        return ParameterGroup("exposures", (self.changes,), rate)

    @property
    def matrices(self) -> Float[Tensor, "v 3 4"]:
        """The maps: a colour x of the scene is A x + b in the image, [A | b] its matrix."""
        return self.changes.detach() + torch.eye(3, 4, device=self.changes.device)

    def apply_to(
        self,
        rendered: RenderOutput,
        numbers: Int[Tensor, " c"],
        background: Float[Tensor, " 3"],
    ) -> RenderOutput:
        """Apply the exposures of training images, by their numbers, to rendered colours.

        The background has no exposure, because it is not part of the photo.
        """
        change = self.changes.index_select(0, numbers)
        shown = rendered.color - (1.0 - rendered.alpha) * background
        gained = torch.einsum("chwi,cji->chwj", shown, change[:, :, :3])
        offset = rendered.alpha * change[:, None, None, :, 3]
        return replace(rendered, color=rendered.color + gained + offset)

    @torch.no_grad()
    def project_(self) -> None:
        """Hold the mean of all maps at the identity, in place."""
        self.changes.sub_(self.changes.mean(dim=0))

    def document(self) -> dict[str, Any]:
        """Plain data for a file."""
        matrices = self.matrices.cpu().tolist()
        return {
            "about": "a colour x of the scene, in [0, 1], is A x + b in the image; rows [A | b]",
            "exposures": dict(zip(self.names, matrices, strict=True)),
        }
