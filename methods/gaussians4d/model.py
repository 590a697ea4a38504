"""Deformed Gaussians: canonical Gaussians, and a field of their differences at each time.

Wu et al. 2024, section 4: positions, rotations and scales at a time are those of the canonical
space plus what the field decodes there (equations 7 and 8); opacity and colour on request. All is
added before activation, so that scales are multiplied. Yang et al. 2024 add to activated scales
(``sum_of_scales``): a scale may then pass through zero, which logarithms never leave again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column
from gsfw.core.context import StepContext
from gsfw.core.learning_rate import LearningRate
from gsfw.core.model import Children
from gsfw.core.numerics import DEFAULT
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.splats import Sh, Splats
from gsfw.methods.gaussians3d.model import MAX_LOG_SCALE, MIN_LOG_SCALE, StaticGaussians
from gsfw.methods.gaussians4d.field import Deformation, DeformationField
from gsfw.methods.moving.gaussians import MovingGaussians
from gsfw.methods.moving.still_rows import StillRows

INSTANTS = 9
"""Number of times over which the changes of the field are averaged."""
OPACITY_INSTANTS = 25
"""Times at which opacities are compared; about as many as time has cells."""
FAINT_LOGIT = torch.tensor(0.99 * DEFAULT.alpha_min, dtype=torch.float64).logit().item()
"""Logit of an opacity that no pixel shows, a little below the limit of the rasterizers."""
FIXED_POINT_STEPS = 5
"""Iterations of x = point - field(x), which invert the motion of the field; the field is smooth."""


class DeformedGaussians(MovingGaussians):
    """Rows are canonical Gaussians; density control treats them as static ones.

    ``deforming`` is false in the coarse phase, which skips the field; ``settled`` is false while
    the field may hide rows that it needs later. Both follow from the step, so they are not part of
    the state.
    """

    step_bytes = 950.0  # Features and layers of the usual field: measured, planes of 32 channels.

    def __init__(
        self,
        canonical: StaticGaussians,
        field: DeformationField,
        rates: Mapping[str, LearningRate],
        still: StillRows | None = None,
        *,
        sum_of_scales: bool = False,
    ) -> None:
        """Combine Gaussians and field.

        Args:
            canonical: the Gaussians.
            field: deformation field of the Gaussians.
            rates: learning rates of the field's "grid" and "network".
            still: mask of static rows; ``None``: no row can be static.
            sum_of_scales: add the field's changes to scales, in box units, not to logarithms.
        """
        super().__init__(canonical, still)
        self._sum_of_scales = sum_of_scales
        self.field = field
        self._rates = rates
        self.deforming = self.settled = True

    def temporal_columns(self) -> Mapping[str, Column]:
        """None: all motion is in the field."""
        return {}

    def parameter_groups(self) -> tuple[ParameterGroup, ...]:
        """Parameter groups of grid (if the encoder has one) and network."""
        groups = {"grid": self.field.grids(), "network": self.field.networks()}
        return tuple(
            ParameterGroup(name, parameters, self._rates[name])
            for name, parameters in groups.items()
            if parameters
        )

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The Gaussians at ``time``; at 0, where a file begins, for ``None``.

        For ``cameras``, rows that are too faint for any pixel may lack changes but of the opacity.
        """
        still = self.canonical.splats()
        if not self.deforming:
            return still
        time = still.means.new_zeros(()) if time is None else time
        rows, logits = self.canonical, self.canonical.opacity_logits.values
        least = None if cameras is None else FAINT_LOGIT - self.taken(logits.detach())
        change = self.field(self.taken(rows.means.values), time, least)
        if change.opacity_logits is not None:
            logits = self.moved(logits, change.opacity_logits)
        assert isinstance(still.colors, Sh)
        return replace(
            still,
            means=self.moved(rows.means.values, change.means),
            quats=self.moved(rows.quats.values, change.quats),
            scales=self._resized(rows.log_scales.values, change.scales),
            opacities=logits.sigmoid(),
            colors=still.colors if change.sh is None else self._shifted(still.colors, change.sh),
        )

    def _resized(
        self, log_scales: Float[Tensor, "n 3"], change: Float[Tensor, "m 3"]
    ) -> Float[Tensor, "n 3"]:
        """Scales with their changes. A negative sum renders like its absolute value."""
        if self._sum_of_scales:
            scales = self.moved(log_scales.exp(), change * self.field.box.size)
            return scales.abs().clamp(math.exp(MIN_LOG_SCALE), math.exp(MAX_LOG_SCALE))
        return self.moved(log_scales, change).clamp(MIN_LOG_SCALE, MAX_LOG_SCALE).exp()

    def _shifted(self, colors: Sh, change: Float[Tensor, "m k 3"]) -> Sh:
        """Add changes to the rendered coefficients of colours."""
        rest = None if colors.rest is None else self.moved(colors.rest, change[:, 1:])
        coefficients = self.moved(colors.coefficients, change[:, :1])
        return replace(colors, coefficients=coefficients, rest=rest)

    @property
    def changing(self) -> bool:
        """True in the fine phase, with the field."""
        return self.deforming

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Regularizers of the field, while it is trained."""
        return self.field.regularizers() if self.deforming else {}

    # For density control, on the canonical Gaussians.

    @torch.no_grad()
    def opacities(self) -> Float[Tensor, " n"]:
        """Canonical opacity of each row, or the largest over the sequence if that is less.

        The canonical opacity alone says little: the field hides many rows at all times (22 to 48 %
        of those of four captures after 1000 to 2300 steps), which then cost time and show nothing.
        Early, before the field is settled, it may show them again.
        """
        canonical = self.canonical.opacities()
        if not self.settled or not self.field.changes_opacities:
            return canonical
        logits, means = (
            self.canonical.opacity_logits.values,
            self.taken(self.canonical.means.values),
        )
        largest = torch.full_like(means[:, 0], -math.inf)
        for time in torch.linspace(0, 1, OPACITY_INSTANTS, device=means.device).to(means):
            largest = largest.maximum(self.field.opacity_change(means, time))
        return canonical.minimum(self.moved(logits, largest).sigmoid())

    @torch.no_grad()
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """Isotropic canonical rows of low opacity, which the field moves to ``points``."""
        still = points.to(self.canonical.means.values)
        if time is not None and self.deforming:
            for _ in range(FIXED_POINT_STEPS):
                still = points - self.field(still, still.new_tensor(time)).means
        return super().rows_at(still, colors, sizes, time)

    def begin_(self, rows: Int[Tensor, " r"], times: Float[Tensor, " r"]) -> None:
        """Canonical values that the field turns, on average, into the rows' current values."""
        if not self.deforming:
            return
        canonical = self.canonical
        start = canonical.means.values[rows]
        still = start
        for _ in range(FIXED_POINT_STEPS):
            still = start - self._average(still).means
        change = self._average(still)
        canonical.means.values[rows] = still
        canonical.log_scales.values[rows] = self._before(
            canonical.log_scales.values[rows], change.scales
        )
        canonical.quats.values[rows] -= change.quats
        if change.opacity_logits is not None:
            canonical.opacity_logits.values[rows] -= change.opacity_logits
        self._recolor_(rows, change, sign=-1.0)

    def _before(
        self, log_scales: Float[Tensor, "r 3"], change: Float[Tensor, "r 3"]
    ) -> Float[Tensor, "r 3"]:
        """Logarithms of the scales that ``change`` turns into these."""
        if not self._sum_of_scales:
            return log_scales - change
        scales = (log_scales.exp() - change * self.field.box.size).abs()
        return scales.log().clamp_min(MIN_LOG_SCALE)

    def end_(self, rows: Int[Tensor, " r"]) -> None:
        """Mean colours over the sequence."""
        if self.deforming:
            self._recolor_(rows, self._average(self.canonical.means.values[rows]), sign=1.0)

    def _recolor_(self, rows: Int[Tensor, " r"], change: Deformation, sign: float) -> None:
        if change.sh is not None:
            self.canonical.sh_dc.values[rows] += sign * change.sh[:, :1]
            if self.canonical.sh_rest is not None:
                self.canonical.sh_rest.values[rows] += sign * change.sh[:, 1:]

    def _average(self, means: Float[Tensor, "r 3"]) -> Deformation:
        """Mean changes by the field, over the sequence, of Gaussians at ``means``."""
        times = torch.linspace(0, 1, INSTANTS, device=means.device).to(means)
        changes = [self.field(means, time) for time in times]

        def mean(values: Sequence[Tensor | None]) -> Tensor | None:
            there = [value for value in values if value is not None]
            return torch.stack(there).mean(0) if there else None

        return Deformation(
            means=torch.stack([change.means for change in changes]).mean(0),
            scales=torch.stack([change.scales for change in changes]).mean(0),
            quats=torch.stack([change.quats for change in changes]).mean(0),
            opacity_logits=mean([change.opacity_logits for change in changes]),
            sh=mean([change.sh for change in changes]),
        )
