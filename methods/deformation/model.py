"""Deformed Gaussians: canonical Gaussians, and a field that says how they differ at each time.

Wu et al. 2024, section 4: positions, rotations and scales at a time are those of the canonical
space plus what the field decodes there (equations 7 and 8); opacity and colour on request. All is
added before activation (Yang et al. 2024 add to activated scales, which may become negative).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.column import Column
from gsfw.core.context import StepContext
from gsfw.core.learning_rate import LearningRate
from gsfw.core.model import Children, PrimitiveModel
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.splats import Sh, Splats
from gsfw.methods.deformation.field import DeformationField
from gsfw.methods.static_gaussians.model import MAX_LOG_SCALE, MIN_LOG_SCALE, StaticGaussians


class DeformedGaussians(PrimitiveModel):
    """Rows are canonical Gaussians, on which density control acts as on static ones.

    ``deforming`` is false in the coarse phase, which leaves the field out. It follows from the
    step, which is why it is not part of the state; until the field is trained it changes nothing.
    """

    def __init__(
        self,
        canonical: StaticGaussians,
        field: DeformationField,
        rates: Mapping[str, LearningRate],
    ) -> None:
        """Join both.

        Args:
            canonical: the Gaussians.
            field: what deforms them.
            rates: learning rates of the field's "grid" and "network".
        """
        super().__init__()
        self.canonical, self.field = canonical, field
        self._rates = rates
        self.deforming = True

    def columns(self) -> Mapping[str, Column]:
        """Those of the canonical Gaussians."""
        return self.canonical.columns()

    def parameter_groups(self) -> tuple[ParameterGroup, ...]:
        """Grid (where the encoder has one) and network."""
        groups = {"grid": self.field.grids(), "network": self.field.networks()}
        return tuple(
            ParameterGroup(name, parameters, self._rates[name])
            for name, parameters in groups.items()
            if parameters
        )

    def splats(self, time: Float[Tensor, ""] | None = None) -> Splats:
        """The Gaussians as they are at ``time``; without one, as they are in canonical space."""
        still = self.canonical.splats()
        if time is None or not self.deforming:
            return still
        rows, logits = self.canonical, self.canonical.opacity_logits.values
        change = self.field(rows.means.values, time)
        if change.opacity_logits is not None:
            logits = logits + change.opacity_logits
        log_scales = rows.log_scales.values + change.log_scales
        assert isinstance(still.colors, Sh)
        return replace(
            still,
            means=rows.means.values + change.means,
            quats=rows.quats.values + change.quats,
            scales=log_scales.clamp(MIN_LOG_SCALE, MAX_LOG_SCALE).exp(),
            opacities=logits.sigmoid(),
            colors=still.colors if change.sh is None else _shifted(still.colors, change.sh),
        )

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Those of the field, while it is trained."""
        return self.field.regularizers() if self.deforming else {}

    def active_bands(self) -> int:
        """Of the canonical Gaussians."""
        return self.canonical.active_bands()

    def project_(self) -> None:
        """Keep the canonical Gaussians in range."""
        self.canonical.project_()

    # What a strategy may ask for, of the canonical Gaussians.

    def opacities(self) -> Float[Tensor, " n"]:
        """Canonical opacity of each row in [0, 1]."""
        return self.canonical.opacities()

    def sizes(self) -> Float[Tensor, " n"]:
        """Largest canonical standard deviation of each row, in scene units."""
        return self.canonical.sizes()

    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Smaller children at points of the row's own Gaussian; the field moves them along."""
        return self.canonical.split_rows(rows, copies, generator)

    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """``rows`` with the opacity and scale of which ``counts`` copies look as one did."""
        return self.canonical.relocated(rows, counts)

    def perturb_(self, rate: float, generator: torch.Generator) -> None:
        """Add noise to canonical positions, where opacity is near nothing."""
        self.canonical.perturb_(rate, generator)

    def lower_opacities_(self, limit: float) -> tuple[str, ...]:
        """Cap every canonical opacity at ``limit``, in (0, 1)."""
        return self.canonical.lower_opacities_(limit)


def _shifted(colors: Sh, change: Float[Tensor, "n k 3"]) -> Sh:
    """Colours with something added to each coefficient that is drawn."""
    rest = None if colors.rest is None else colors.rest + change[:, 1:]
    return replace(colors, coefficients=colors.coefficients + change[:, :1], rest=rest)
