"""RoundedModel: a model as it is with rounded columns, for training that knows of the rounding.

Straight-through estimator (Bengio et al. 2013, arXiv 1308.3432): the splats are made of the rounded
values, and their gradients are those of the values themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column
from gsfw.core.model import PrimitiveModel
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Splats

Rounded = Callable[[str, Tensor], Tensor]
"""Receives the name of a column and its values; returns them rounded, without a gradient."""


class RoundedModel(PrimitiveModel):
    """Renders a model with rounded columns; its own columns are those of the model, as they are."""

    def __init__(self, model: PrimitiveModel, rounded: Rounded) -> None:
        """Wrap a model, which may be trained meanwhile.

        Args:
            model: it is not changed.
            rounded: rounds the values of a column.
        """
        super().__init__()
        self.model, self.depends_on_view = model, model.depends_on_view
        self._rounded = rounded
        places = {id(module): place for place, module in self.named_modules()}
        self._places = {name: places[id(column)] for name, column in self.columns().items()}

    def columns(self) -> Mapping[str, Column]:
        """The columns of the model, as they are."""
        return self.model.columns()

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The splats of the rounded columns; gradients reach the columns as if not rounded."""
        seen = {
            f"{self._places[name]}.values": straight_through(
                column.values, self._rounded(name, column.values)
            )
            for name, column in self.columns().items()
            if column.trained
        }
        found: Splats = torch.func.functional_call(self, seen, (time, cameras))
        return found

    def forward(self, time: Float[Tensor, ""] | None, cameras: Cameras | None) -> Splats:
        """The splats of the model's present columns."""
        return self.model.splats(time, cameras)

    def decode(self, output: RenderOutput, cameras: Cameras) -> RenderOutput:
        """The model's decoding."""
        return self.model.decode(output, cameras)


def straight_through(values: Tensor, rounded: Tensor) -> Tensor:
    """The rounded values to the last bit, with the gradient of the values."""
    return rounded + (values - values.detach())
