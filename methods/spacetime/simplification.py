"""Simplification: removes the temporal parameters that rows do not use.

A row is evaluated while it is present: at nine times within three deviations of its centre, each
weighted by its presence. It loses, in this order,

- its temporal opacity, if that is nearly the same over the whole sequence: the row is then always
  present, with its mean opacity, on the same path;
- the highest powers of its path, if the closest polynomial of a lower degree, by least squares,
  stays within a tolerance of it, relative to the row's size. That polynomial becomes its path;
- its rotation, if its covariance hardly changes, and the change of its features, likewise.

So images stay the same within the tolerance. Nothing is added back here: static rows
(static=auto) start with all parameters when they begin to move.

All rows start with all parameters, as trained values predict the use of a parameter best: see
``gaussians3d.adaptive_bands``, with the same measurement for colours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from gsfw.core.refiner import RefineContext, Refinement, Refiner
from gsfw.core.table import SplatTable
from gsfw.methods.moving.covariances import covariances
from gsfw.methods.moving.settling import MAX_OPACITY, MIN_OPACITY
from gsfw.methods.spacetime.adaptive_model import MIDDLE, AdaptiveSpacetimeGaussians
from gsfw.methods.spacetime.polynomial import displacement, recentered

if TYPE_CHECKING:
    from gsfw.methods.spacetime.config import SpacetimeConfig

INSTANTS = 9
"""Number of times at which each row is evaluated; polynomials bend less often."""
REACH = 3.0
"""Deviations from its centre up to which a row is evaluated: 1 % of its opacity is left there."""


class Simplification(Refiner):
    """Simplifies rows every ``motion_every`` steps, from ``motion_start`` on."""

    name = "motion"
    divisible = False

    def __init__(self, config: SpacetimeConfig, model: AdaptiveSpacetimeGaussians) -> None:
        """Store the model whose rows lose parameters."""
        self._config, self._model = config, model

    def refine(self, context: RefineContext) -> Refinement:
        """Simplify all rows if a round is due."""
        config, since = self._config, context.done - self._config.motion_start
        if since < 0 or since % config.motion_every:
            return {}
        return simplify(self._model, context.table, config.motion_tolerance)


@torch.no_grad()
def simplify(model: AdaptiveSpacetimeGaussians, table: SplatTable, tolerance: float) -> Refinement:
    """Run one round over all rows; return the number of removals by parameter.

    Args:
        model: model whose rows are in ``table``.
        table: table of its rows.
        tolerance: largest change, relative to size, shape and opacity.
    """
    patient = torch.ones(len(table), dtype=torch.bool, device=table.device)
    if model.still is not None:  # Rows that just began to move have not used their parameters yet.
        patient = model.still.terms.values[:, 0] == 0
    always = _always_there(model, patient, tolerance)
    _forget_time_(model, table, always)
    seen = _Seen.of(model)
    before = model.lengths("motion")
    orders = _straighten_(model, seen, patient, tolerance)
    table.resize("motion", orders)
    lost = {"always_there": len(always), "orders_lost": int((before - orders).sum())}
    for name in ("spins", "feature_rates"):
        if name in model.temporal_columns():
            lost[f"{name}_lost"] = _fix_(model, table, name, seen, patient, tolerance)
    return lost


# Temporal opacities.


def _always_there(
    model: AdaptiveSpacetimeGaussians, patient: Bool[Tensor, " n"], tolerance: float
) -> Int[Tensor, " r"]:
    """Rows with a temporal opacity that is nearly the same over the whole sequence."""
    columns = model.temporal_columns()
    centers, log_durations = columns["time_centers"].values, columns["log_durations"].values
    furthest = torch.maximum(centers, 1.0 - centers) / log_durations.exp()
    least = model.everywhere(torch.exp(-0.5 * furthest.square()), otherwise=0.0)
    return ((least >= 1.0 - tolerance) & patient).nonzero()[:, 0]


def _forget_time_(
    model: AdaptiveSpacetimeGaussians, table: SplatTable, rows: Int[Tensor, " r"]
) -> None:
    """Make rows permanent, with their mean opacity, on the same paths."""
    canonical, columns = model.canonical, model.temporal_columns()
    opacities = canonical.opacities()[rows] * model.lifetimes()[rows]
    canonical.opacity_logits.values[rows] = opacities.clamp(MIN_OPACITY, MAX_OPACITY).logit()
    shifts = torch.zeros_like(model.centers()).index_copy(0, rows, MIDDLE - model.centers()[rows])
    paths = model.paths()
    canonical.means.values.add_(displacement(paths, shifts))
    columns["motion"].values.copy_(model.places("motion").packed(recentered(paths, shifts)))
    for name, values in model.turning().items():
        with_rate = model.places(name).rows
        values.index_add_(0, with_rate, columns[name].values * shifts[with_rate, None])
    lengths = model.lengths("time_centers").clone()
    lengths[rows] = 0
    for name in ("time_centers", "log_durations"):
        table.resize(name, lengths)


# Motion of rows while they are present.


@dataclass(frozen=True)
class _Seen:
    """Times at which all rows are evaluated."""

    centers: Float64[Tensor, " n"]
    middles: Float64[Tensor, " n"]
    """Centre of the interval in which a row is present."""
    halves: Float64[Tensor, " n"]
    """Half of the length of that interval."""
    weights: Float64[Tensor, "n i"]
    """Presence of the row at equal steps through the interval."""
    sizes: Float64[Tensor, " n"]
    """Root mean square of the standard deviations, in scene units."""

    @staticmethod
    def of(model: AdaptiveSpacetimeGaussians) -> _Seen:
        """The current times."""
        columns, centers = model.temporal_columns(), model.centers().double()
        durations = columns["log_durations"].values.exp()
        durations = model.everywhere(durations, otherwise=torch.inf).double()
        first = (centers - REACH * durations).clamp_min(0.0)
        last = (centers + REACH * durations).clamp_max(1.0)
        middles, halves = (first + last) / 2, (last - first) / 2
        elapsed = middles[:, None] + halves[:, None] * _steps(centers) - centers[:, None]
        weights = torch.exp(-0.5 * (elapsed / durations[:, None]).square())
        variances = (2.0 * model.canonical.log_scales.values.double()).exp()
        return _Seen(centers, middles, halves, weights, variances.mean(1).sqrt())

    def take(self, rows: Int[Tensor, " r"]) -> _Seen:
        """Select rows."""
        values = (self.centers, self.middles, self.halves, self.weights, self.sizes)
        return _Seen(*(value[rows] for value in values))

    def balance(self) -> Float64[Tensor, " n"]:
        """Time at which a straight line has its mean over the weighted times."""
        squares = self.weights.square()
        return self.middles + self.halves * (squares @ _steps(squares)) / squares.sum(1)


def _steps(like: Tensor) -> Tensor:
    return torch.linspace(-1.0, 1.0, INSTANTS, dtype=like.dtype, device=like.device)


# Paths.


def _straighten_(
    model: AdaptiveSpacetimeGaussians,
    seen: _Seen,
    patient: Bool[Tensor, " n"],
    tolerance: float,
) -> Int[Tensor, " n"]:
    """Put rows on the simplest paths within the tolerance; return their new orders.

    The values of the column are written, but not yet cut.
    """
    orders = model.lengths("motion").clone()
    paths, means = model.paths(), model.canonical.means.values
    for order in range(model.order):
        rows = ((orders > order) & patient).nonzero()[:, 0]
        simpler = _closest(paths[rows].double(), order, some := seen.take(rows))
        fits = simpler.errors <= tolerance * some.sizes
        rows = rows[fits]
        orders[rows] = order
        paths[rows] = 0.0
        paths[rows, :order] = simpler.path[fits].to(paths)
        means[rows] += simpler.shift[fits].to(means)
    model.temporal_columns()["motion"].values.copy_(model.places("motion").packed(paths))
    return orders


@dataclass(frozen=True)
class _Simpler:
    """Paths of a lower degree."""

    path: Float64[Tensor, "r k 3"]
    """Coefficients about the centres."""
    shift: Float64[Tensor, "r 3"]
    """Shift of the positions at the centres."""
    errors: Float64[Tensor, " r"]
    """Largest distance of the old and the new path, weighted by the presence of the row."""


def _closest(paths: Float64[Tensor, "r k 3"], order: int, seen: _Seen) -> _Simpler:
    """The closest polynomials of a degree to some paths, by least squares."""
    # Relative to the interval, [-1, 1], nothing depends on the durations of rows.
    shifts, steps = seen.middles - seen.centers, _steps(seen.centers)
    powers = seen.halves[:, None] ** torch.arange(1, paths.shape[1] + 1, device=paths.device)
    inside = recentered(paths, shifts) * powers[:, :, None]
    basis = steps[:, None] ** torch.arange(order + 1, device=paths.device)
    upper = steps[:, None] ** torch.arange(1, paths.shape[1] + 1, device=paths.device)
    places = torch.einsum("ik,rkd->rid", upper, inside)
    squares = seen.weights.square()
    normal = torch.einsum("ri,ia,ib->rab", squares, basis, basis)
    right = torch.einsum("ri,ia,rid->rad", squares, basis, places)
    fitted = torch.linalg.solve(normal, right)
    errors = (places - torch.einsum("ia,rad->rid", basis, fitted)).norm(dim=2)
    new = fitted[:, 1:] / powers[:, :order, None]
    middle = displacement(paths, shifts) + fitted[:, 0]
    return _Simpler(
        recentered(new, -shifts) if order else new,
        middle + (displacement(new, -shifts) if order else 0.0),
        (seen.weights * errors).amax(1),
    )


# Rotations and features.


def _fix_(
    model: AdaptiveSpacetimeGaussians,
    table: SplatTable,
    name: str,
    seen: _Seen,
    patient: Bool[Tensor, " n"],
    tolerance: float,
) -> int:
    """Replace changes at a rate by their mean within the tolerance; return their number."""
    rows, rates = model.places(name).rows, model.temporal_columns()[name].values.detach()
    some, values = seen.take(rows), model.turning()[name]
    since = some.balance() - some.centers
    average = values[rows] + rates * since.to(rates)[:, None]
    elapsed = some.middles[:, None] + some.halves[:, None] * _steps(since) - some.centers[:, None]
    changed = torch.zeros_like(some.sizes)
    for weight, time in zip(some.weights.T, elapsed.T, strict=True):
        now = values[rows] + rates * time.to(rates)[:, None]
        changed = torch.maximum(changed, weight * _difference(model, name, rows, now, average))
    fixed = (changed <= tolerance) & patient[rows]
    values[rows[fixed]] = average[fixed]
    lengths = model.lengths(name).clone()
    lengths[rows[fixed]] = 0
    table.resize(name, lengths)
    return int(fixed.sum())


def _difference(
    model: AdaptiveSpacetimeGaussians,
    name: str,
    rows: Int[Tensor, " r"],
    now: Float[Tensor, "r d"],
    average: Float[Tensor, "r d"],
) -> Float64[Tensor, " r"]:
    """Change of shapes, relative to them; change of features, absolute."""
    if name != "spins":
        return (now - average).double().norm(dim=1)
    scales = model.canonical.log_scales.values[rows].double().exp()
    shape = covariances(average.double(), scales).flatten(1)
    return (covariances(now.double(), scales).flatten(1) - shape).norm(dim=1) / shape.norm(dim=1)
