"""Opacity penalty: the mean opacity as a term of the loss.

The term is that of Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo",
section 3.4, for any strategy. Splats that change no image, such as white ones before a white
background, lose their opacity and are pruned; they would hide surfaces from other cameras.
"""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.refiner import RefineContext, Refinement, Refiner


class OpacityPenalty(Refiner):
    """Adds the weighted mean opacity to the loss; edits no rows."""

    name = "opacity-penalty"

    def __init__(self, weight: float) -> None:
        """Store the weight, above 0."""
        self._weight = weight

    def can_be_recorded(self, step: int) -> bool:
        """True: the term depends on the parameters alone."""
        return True

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """The mean opacity of the rendered splats, weighted."""
        return {"opacity_penalty": self._weight * context.splats.opacities.mean()}

    def refine(self, context: RefineContext) -> Refinement:
        """Edit nothing."""
        return {}
