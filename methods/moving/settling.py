"""Settling: rows that do not need time become static, and static rows that need it move again.

A moving row is compared over the whole sequence. If its position, shape, opacity and colour change
by less than a tolerance, relative to its own size, it becomes its mean. A static row begins to move
when its gradients depend on time (see ``still_rows``). The splats at a time are the only input from
a model.

3D-4DGS (2025) turns Gaussians with a long duration, in seconds, into static ones for good; Ex4DGS
(2024) turns the few static ones with the largest drift into dynamic ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.maths.frame import with_axes
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.model import PrimitiveModel
from gsfw.core.refiner import RefineContext, Refinement, Refiner
from gsfw.core.splats import Sh, Splats
from gsfw.core.table import SplatTable
from gsfw.methods.moving.covariances import covariances
from gsfw.methods.moving.gaussians import MovingGaussians

if TYPE_CHECKING:
    from gsfw.methods.moving.config import MovingConfig

INSTANTS = 9
"""Times at which rows are compared: eighths of the sequence. Fields and polynomials bend less."""
MIN_OPACITY, MAX_OPACITY = 1e-6, 1 - 1e-6
"""Largest opacity: a saturated sigmoid has no gradient."""
FLATTEST = 1e-4
"""Least ratio of axes: with flatter Gaussians rounding leaves more of a covariance undefined."""


class Settling(Refiner):
    """Compares rows at several times in regular rounds; makes them static, or lets them move."""

    name = "settling"
    divisible = False

    def __init__(self, config: MovingConfig, model: MovingGaussians) -> None:
        """Store a model with rows that may be static.

        Args:
            config: schedule, tolerance and signal.
            model: has ``still``.
        """
        self._config, self._model = config, model

    def can_be_recorded(self, step: int) -> bool:
        """True: each step adds to the evidence of the same rows, until rows stop or start.

        A step whose images had no room adds evidence too; a single one cannot start a row
        (``StillRows``).
        """
        return True

    def before_backward(self, context: StepContext, model: PrimitiveModel) -> None:
        """Watch the gradients of static rows."""
        still, time = self._model.still, context.batch.time
        if still is not None and time is not None:
            still.watch(context.splats, time)

    def refine(self, context: RefineContext) -> Refinement:
        """Stop and start rows, every ``static_every`` steps after ``static_start``."""
        config, done = self._config, context.done
        due = done > config.static_start and done % config.static_every == 0
        if not due or not self._model.changing:
            return {}
        return settle(
            self._model,
            context.table,
            tolerance=config.static_tolerance,
            signal=config.static_signal,
        )


@dataclass
class _Range:
    """Minimum, maximum and mean of values over the compared instants."""

    least: Float[Tensor, "m d"]
    greatest: Float[Tensor, "m d"]
    total: Float[Tensor, "m d"]

    def add(self, values: Float[Tensor, "m d"]) -> None:
        """Add one more instant."""
        self.least = torch.minimum(self.least, values)
        self.greatest = torch.maximum(self.greatest, values)
        self.total = self.total + values

    @property
    def mean(self) -> Float[Tensor, "m d"]:
        """Mean over the instants."""
        return self.total / INSTANTS

    @property
    def reach(self) -> Float[Tensor, " m"]:
        """Half of the distance between the extremes."""
        return (self.greatest - self.least).norm(dim=1) / 2


@torch.no_grad()
def settle(
    model: MovingGaussians, table: SplatTable, *, tolerance: float, signal: float
) -> Refinement:
    """Run one round over all rows of a model with static rows.

    Args:
        model: model with ``still``.
        table: table of its rows.
        tolerance: largest change of a static row, relative to size, shape and opacity.
        signal: the ratio above which rows begin to move.
    """
    still = model.still
    assert still is not None
    standing, signals, wanted = still.rows(), still.signals(), still.wanted()
    stopped, at_rest = _resting(model, (still.patient() & ~still.mask()).nonzero()[:, 0], tolerance)
    started = standing[signals > signal]
    if len(stopped):
        model.stop_(table, stopped, at_rest)
    if len(started):
        model.start_(table, started, wanted[signals > signal])
    still.forget_()
    return {"stopped": len(stopped), "started": len(started)}


def _resting(
    model: MovingGaussians, rows: Int[Tensor, " m"], tolerance: float
) -> tuple[Int[Tensor, " r"], Splats]:
    """Select the ``rows`` that hardly change over the sequence, and compute their mean splats."""
    times = torch.linspace(0.0, 1.0, INSTANTS, device=rows.device)
    ranges = tuple(_Range(found, found, found) for found in _look(model.splats(times[0]), rows))
    for time in times[1:]:
        for known, found in zip(ranges, _look(model.splats(time), rows), strict=True):
            known.add(found)
    means, shapes, opacities, colors = ranges
    size = shapes.mean[:, [0, 4, 8]].sum(1).div(3).sqrt()
    rests = means.reach <= tolerance * size
    rests &= shapes.reach <= tolerance * shapes.mean.norm(dim=1)
    rests &= (opacities.least >= (1.0 - tolerance) * opacities.greatest)[:, 0]
    rests &= colors.reach <= tolerance
    average = Splats(
        means=means.mean[rests],
        opacities=opacities.mean[rests, 0].clamp(MIN_OPACITY, MAX_OPACITY),
        colors=colors.mean[rests],
        covariances=shapes.mean[rests].view(-1, 3, 3),
    )
    return rows[rests], _with_thick_axes(average)


def _look(splats: Splats, rows: Int[Tensor, " m"]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Positions, shapes, opacities and colours of some rows, each [m, d]; shapes in float64."""
    assert splats.rows is None
    shapes = splats.covariances
    if shapes is None:
        assert splats.quats is not None
        assert splats.scales is not None
        shapes = covariances(splats.quats[rows].double(), splats.scales[rows].double())
    else:
        shapes = shapes[rows].double()
    base = splats.colors.coefficients[:, 0] * C0 if isinstance(splats.colors, Sh) else splats.colors
    colors = [base[rows]] if splats.extra is None else [base[rows], splats.extra[rows]]
    opacities = splats.opacities[rows, None]
    return splats.means[rows], shapes.flatten(1), opacities, torch.cat(colors, dim=1)


def _with_thick_axes(splats: Splats) -> Splats:
    """Splats by quaternions and scales, none of them much smaller than the row's largest."""
    splats = with_axes(splats)
    assert splats.scales is not None
    thinnest = FLATTEST * splats.scales.amax(dim=1, keepdim=True)
    return replace(splats, scales=splats.scales.maximum(thinnest))
