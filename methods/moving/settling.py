"""Settling: rows that do not need time come to a stand, and those that do begin to move again.

A row that moves is looked at over the whole sequence. Where neither its place, nor its shape, nor
its opacity, nor its colour change by more than a tolerance, in terms of its own size, it becomes
what it is on average. A row that stands still begins to move when its gradients have to do with
time (see ``still_rows``). What is drawn at a time is all that this needs to know of a model.

3D-4DGS (2025) turns Gaussians that are there for long into static ones by a duration in seconds,
for good; Ex4DGS (2024) turns the few static ones that drift the most into dynamic ones.
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
"""Times at which rows are looked at: eighths of the sequence. Fields and polynomials bend less."""
MIN_OPACITY, MAX_OPACITY = 1e-6, 1 - 1e-6
"""A saturated sigmoid has no gradient to come back by."""
FLATTEST = 1e-4
"""Thinnest to thickest axis: rounding leaves less of a flat Gaussian's covariance undefined."""


class Settling(Refiner):
    """Compares rows at several times every so many steps; lets them stop, or start to move."""

    name = "settling"

    def __init__(self, config: MovingConfig, model: MovingGaussians) -> None:
        """Take a model of which some rows may stand still.

        Args:
            config: schedule, tolerance and signal.
            model: has ``still``.
        """
        self._config, self._model = config, model

    def before_backward(self, context: StepContext, model: PrimitiveModel) -> None:
        """Watch the gradients of rows that stand still."""
        still, time = self._model.still, context.batch.time
        if still is not None and time is not None:
            still.watch(context.splats, time)

    def refine(self, context: RefineContext) -> Refinement:
        """Let rows stop and start, every ``static_every`` steps after ``static_start``."""
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
    """Least, greatest and mean of something over the instants looked at."""

    least: Float[Tensor, "m d"]
    greatest: Float[Tensor, "m d"]
    total: Float[Tensor, "m d"]

    def add(self, values: Float[Tensor, "m d"]) -> None:
        """Take in one more instant."""
        self.least = torch.minimum(self.least, values)
        self.greatest = torch.maximum(self.greatest, values)
        self.total = self.total + values

    @property
    def mean(self) -> Float[Tensor, "m d"]:
        """Over the instants."""
        return self.total / INSTANTS

    @property
    def reach(self) -> Float[Tensor, " m"]:
        """Half of the way from one extreme to the other."""
        return (self.greatest - self.least).norm(dim=1) / 2


@torch.no_grad()
def settle(
    model: MovingGaussians, table: SplatTable, *, tolerance: float, signal: float
) -> Refinement:
    """One look at all rows of a model of which some may stand still.

    Args:
        model: with ``still``.
        table: of its rows.
        tolerance: what counts as standing still, relative to size, shape and opacity.
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
    """Those of ``rows`` that hardly change over the sequence, and what they are on average."""
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
    """Places, shapes, opacities and colours of some rows, each [m, d]; shapes in float64."""
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
    """By quaternions and scales, none of them much smaller than the row's largest."""
    splats = with_axes(splats)
    assert splats.scales is not None
    thinnest = FLATTEST * splats.scales.amax(dim=1, keepdim=True)
    return replace(splats, scales=splats.scales.maximum(thinnest))
