"""StepContext: what losses, regularisers and strategies are given."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Splats


@dataclass(frozen=True)
class StepContext:
    """One batch of one step, drawn."""

    step: int
    """Counted from 0."""
    steps: int
    """Length of the run."""
    phase: str
    """The method's phase, such as "train", "coarse" or "fine"."""
    batch: Batch
    splats: Splats
    """What was drawn, still attached to the graph."""
    rendered: RenderOutput
    """After ``PrimitiveModel.decode``; its statistics are those of the rasterizer."""
    target: Float[Tensor, "c h w 3"]
    """The batch's pictures over this step's background."""
    num_rows: int
    """Rows of the model; ``splats.rows`` counts among them."""
    share: float
    """This batch's part of the step's loss: its views over all views of the step."""
    extent: float
    """The scene's extent, in scene units."""
    operators: Operators
    generator: torch.Generator
