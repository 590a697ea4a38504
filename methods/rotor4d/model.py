"""Sliced Gaussians: ellipsoids of space and time; an instant renders their slices.

Duan et al. 2024, "4D-Rotor Gaussian Splatting: Towards Efficient Novel View Synthesis for Dynamic
Scenes"; with rotation=two-quaternions Yang et al. 2024, without its 4D spherical harmonics.
``conditional`` defines a slice: a Gaussian that moves along a straight line and fades.

Differences from the released codes: rotations are projected, unlike 4D-Rotor's; slices are computed
without cancellation; rows that are invisible at every pixel are skipped, not those at several
deviations; no row lives shorter than half the time between two images; children of a split are
sampled from their parent within the sequence, so that none starts outside of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column, Rows
from gsfw.core.context import StepContext
from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.covariance_noise import noise_strengths
from gsfw.core.maths.slices import Conditional, Slices, conditional, time_variances, weights
from gsfw.core.maths.symmetric import largest_eigenvalues
from gsfw.core.model import Children
from gsfw.core.numerics import DEFAULT
from gsfw.core.operators import Operators
from gsfw.core.splats import Splats
from gsfw.methods.gaussians3d.model import (
    MIN_LOG_SCALE,
    SPLIT_SHRINK,
    StaticGaussians,
)
from gsfw.methods.moving.center_gradient import center_gradients
from gsfw.methods.moving.covariances import covariances
from gsfw.methods.moving.gaussians import MovingGaussians, moving_children, taken_rows
from gsfw.methods.moving.presence import Presence
from gsfw.methods.moving.still_rows import StillRows
from gsfw.methods.rotor4d.neighbor_graph import NeighborGraph
from gsfw.methods.rotor4d.regularization import Regularization, disagreement, entropy
from gsfw.methods.rotor4d.rotation import Rotation

MAX_DURATION = 10.0
"""Longest scale in time, in sequences: the opacity then changes by 0.5 % at most."""
NEW_DURATION = 0.2
"""Standard deviation in time of new rows at rendering errors."""
NEIGHBORS = 8
"""Number of neighbours in the comparison of velocities, as in the paper."""
SEQUENCE_LENGTH = 1.0
"""Distance of the ends of the sequence in the search of neighbours, in extents. The paper has 5 in
the units of D-NeRF, whose cameras stand 4 away from the origin."""


class SlicedGaussians(MovingGaussians):
    """Static Gaussians with a fourth axis each.

    ``canonical`` holds the columns of static Gaussians. Its quaternion is the first of a rotation's
    two; ``time_quats`` has the second, ``log_durations`` the scale along the fourth axis.
    Static rows have neither: they are static Gaussians, with that first quaternion.
    """

    divisible, step_bytes = False, 1450.0  # Neighbours, and 4D covariances: measured.

    def __init__(
        self,
        canonical: StaticGaussians,
        time_centers: Float[Tensor, " n"],
        rates: Mapping[str, LearningRate],
        rotation: Rotation,
        operators: Operators,
        *,
        duration: float,
        min_duration: float,
        regularization: Regularization,
        still: StillRows | None = None,
    ) -> None:
        """Start with Gaussians without motion.

        Args:
            canonical: initial static Gaussians.
            time_centers: times of their largest opacity.
            rates: learning rate of every column.
            rotation: trained form of rotations.
            operators: for slices and neighbours.
            duration: initial standard deviation in time, in sequences.
            min_duration: the shortest standard deviation.
            regularization: weights of the regularizers.
            still: mask of rows without a fourth axis; ``None``: no row can be static.
        """
        super().__init__(canonical, still)
        self._rotation, self._regularization = rotation, regularization
        self._operators = operators
        self._min_variance = min_duration**2
        quats = canonical.quats.values.detach()
        first, second = rotation.of_space(quats)
        quats.copy_(first)
        log_durations = torch.full_like(time_centers, math.log(duration))
        self.time_quats = self.temporal_column(second, rates["time_quats"])
        self.time_centers = self.temporal_column(time_centers, rates["time_centers"])
        self.log_durations = self.temporal_column(log_durations, rates["log_durations"])
        self.graph = NeighborGraph(NEIGHBORS, regularization.refresh_every)
        self.project_()

    def temporal_columns(self) -> Mapping[str, Column]:
        """The columns time_quats, time_centers and log_durations."""
        return {
            "time_quats": self.time_quats,
            "time_centers": self.time_centers,
            "log_durations": self.log_durations,
        }

    # Rendering.

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The visible slices at ``time``, or all; at 0, where a file begins, for ``None``."""
        centers = self.time_centers.values
        time = centers.new_zeros(()) if time is None else time.to(centers)
        rows = self._visible_rows(time) if self.selects else None
        still = self._still(rows)
        sliced, elapsed = self._sliced(rows), time - taken_rows(centers, rows)
        faded = self.everywhere(weights(elapsed, sliced.variances), otherwise=1.0)
        return replace(
            still,
            means=self.moved(still.means, sliced.velocities * elapsed[:, None]),
            opacities=still.opacities * faded,
            covariances=self._with_standing(sliced.covariances),
            quats=None,
            scales=None,
        )

    @property
    def selects(self) -> bool:
        """True if only visible rows are sliced, for whose number the host waits; none are static.

        A selection would copy the static ones.
        """
        return self.still is None and not self._operators.fixed_shapes

    @torch.no_grad()
    def _visible_rows(self, time: Float[Tensor, ""]) -> Int[Tensor, " m"] | None:
        """Rows that are opaque enough to be visible at a pixel; ``None`` when all are."""
        faded = weights(time - self.time_centers.values, self._variances())
        rows = _visible(self.canonical.opacities() * faded).nonzero()[:, 0]
        return None if len(rows) == len(faded) else rows

    def _still(self, rows: Int[Tensor, " m"] | None = None) -> Splats:
        """The static Gaussians of ``rows``, or of all rows, without their fourth axis."""
        still = self.canonical.splats()
        if rows is None:
            return still
        return replace(still.take(rows), rows=rows)

    def _sliced(self, rows: Int[Tensor, " r"] | None = None) -> Slices:
        """Slices of moving rows, at any time; of ``rows``, for a model in which all rows move."""
        columns = self.canonical.columns()
        first, log_scales = (
            self.taken(taken_rows(columns[name].values, rows)) for name in ("quats", "log_scales")
        )
        second, log_durations = (
            taken_rows(column.values, rows) for column in (self.time_quats, self.log_durations)
        )
        scales = torch.cat([log_scales, log_durations[:, None]], dim=1).exp()
        return self._operators.slices(*self._rotation.sides(first, second), scales)

    def _conditional(
        self,
        quats: Float[Tensor, "m 4"],
        log_scales: Float[Tensor, "m 3"],
        time_quats: Float[Tensor, "m 4"],
        log_durations: Float[Tensor, " m"],
    ) -> Conditional:
        scales = torch.cat([log_scales, log_durations[:, None]], dim=1).exp()
        return conditional(self._rotation.matrices(quats, time_quats), scales)

    def _with_standing(self, changing: Float[Tensor, "m 3 3"]) -> Float[Tensor, "n 3 3"]:
        """Covariances of all rows, moving and static."""
        moving = self.moving()
        if self.still is None or moving is None:
            return changing
        rows, canonical = self.still.rows(), self.canonical
        quats, log_scales = (
            column.values.index_select(0, rows)
            for column in (canonical.quats, canonical.log_scales)
        )
        standing = covariances(quats, log_scales.exp())
        everywhere = changing.new_zeros(self.num_rows, 3, 3)
        return everywhere.index_copy(0, rows, standing).index_copy(0, moving, changing)

    # Training.

    def refresh_neighbors_(self, step: int, extent: float) -> None:
        """Search for the neighbours of moving rows, if it is time for it, before a step."""
        centers = self.time_centers.values.detach()
        needed = self._regularization.velocity > 0 and len(centers) > 1
        if needed and self.graph.is_due(step, len(centers)):
            means = self.taken(self.canonical.means.values.detach())
            placed = SEQUENCE_LENGTH * extent * centers[:, None]
            self.graph.refresh_(torch.cat([means, placed], dim=1), self._operators)

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Entropy of the opacities, and differences of velocities from those of neighbours."""
        weight, rows = self._regularization, context.splats.rows
        terms: dict[str, Tensor] = {}
        if weight.entropy > 0:
            seen = context.rendered.statistics.visible.any(0)
            if rows is not None:
                everywhere = seen.new_zeros(self.num_rows)
                seen = everywhere.index_copy(0, rows, seen)
            terms["entropy"] = weight.entropy * entropy(self.canonical.opacity_logits.values, seen)
        if weight.velocity > 0 and len(self.time_centers.values) > 1:
            different = self._disagreement(context.splats)
            terms["velocity"] = weight.velocity * different / context.extent
        return terms

    def _disagreement(self, splats: Splats) -> Float[Tensor, ""]:
        """Mean difference of the velocities of visible rows from the means of their neighbours.

        Neighbours are among the moving rows: static ones must not slow them down.
        """
        velocities, rows = self._sliced().velocities, splats.rows
        if rows is None:
            rows = torch.arange(len(velocities), device=velocities.device)
        chosen, around = velocities.index_select(0, rows), self.graph.mean(velocities, rows)
        every = self.selects or self.still is not None
        return disagreement(chosen, around, None if every else _visible(splats.opacities.detach()))

    @torch.no_grad()
    def project_(self) -> None:
        """Project rotations, clamp scales to the range of exp, and enforce the least duration."""
        quats, rows = self.taken(self.canonical.quats.values), self.moving()
        self._rotation.project_(quats, self.time_quats.values)
        if rows is not None:
            self.canonical.quats.values.index_copy_(0, rows, quats)
        self.canonical.project_()
        self.log_durations.values.clamp_(MIN_LOG_SCALE, math.log(MAX_DURATION))
        self._lengthen_()

    def _lengthen_(self) -> None:
        """Stretch rows with a short duration, along the axis that is nearest to time."""
        time, scales = self._time_rows(), self._scales()
        missing = self._min_variance - time_variances(time, scales)
        share, axis = time.abs().max(dim=0)
        chosen = scales.gather(1, axis[:, None])[:, 0]
        longer = (chosen.square() + missing.clamp_min(0.0) / share.square()).sqrt().log()
        short = (missing > 0)[:, None] & (axis[:, None] == torch.arange(4, device=axis.device))
        rows, log_durations = self.moving(), self.log_durations.values
        log_scales = self.canonical.log_scales.values
        stretched = torch.where(short[:, :3], longer[:, None], self.taken(log_scales))
        log_scales.copy_(stretched if rows is None else log_scales.index_copy(0, rows, stretched))
        log_durations.copy_(torch.where(short[:, 3], longer, log_durations))

    # For density control.

    # Of rows that change:

    def _scales(self) -> Float[Tensor, "m 4"]:
        """Standard deviations along the rotated axes."""
        log_scales = self.taken(self.canonical.log_scales.values)
        return torch.cat([log_scales, self.log_durations.values[:, None]], dim=1).exp()

    def _time_rows(self) -> Float[Tensor, "4 m"]:
        quats = self.taken(self.canonical.quats.values)
        return self._rotation.time_rows(quats, self.time_quats.values)

    @torch.no_grad()
    def _variances(self) -> Float[Tensor, " m"]:
        """In time, in sequences squared."""
        return time_variances(self._time_rows(), self._scales())

    @torch.no_grad()
    def _presence(self) -> Presence:
        return Presence(self.time_centers.values.detach(), self._variances())

    def opacities(self) -> Float[Tensor, " n"]:
        """Largest opacity of each row in [0, 1]."""
        return self.canonical.opacities() * self.everywhere(self._presence().peaks(), 1.0)

    @torch.no_grad()
    def sizes(self) -> Float[Tensor, " n"]:
        """Largest standard deviation of each row's slices, in scene units."""
        variances = largest_eigenvalues(self._sliced().covariances)
        sizes, rows = variances.clamp_min(0.0).sqrt(), self.moving()
        return sizes if rows is None else self.canonical.sizes().index_copy(0, rows, sizes)

    def lifetimes(self) -> Float[Tensor, " n"]:
        """Mean temporal weight of each row over the sequence: 1 for always present rows."""
        return self.everywhere(self._presence().means(), otherwise=1.0)

    def time_gradients(self) -> Float[Tensor, " n"] | None:
        """|dL / d temporal centre| of each row, through its opacity and its position."""
        return center_gradients(self.time_centers)

    @torch.no_grad()
    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Children sampled from each row's Gaussian, smaller in space and in time."""
        children = dict(self.clone_rows(rows.repeat(copies)))
        means, moving = children["means"].values, moving_children(children)
        quats, log_scales = (
            taken_rows(children[name].values, moving) for name in ("quats", "log_scales")
        )
        temporal = (children[name].values for name in ("time_quats", "log_durations"))
        sliced, centers = self._conditional(quats, log_scales, *temporal), children["time_centers"]
        times = Presence(centers.values, sliced.variances).draw(generator)
        noise = torch.randn(len(times), 4, generator=generator, device=means.device).to(means)
        placed = taken_rows(means, moving) + sliced.velocities * (times - centers.values)[:, None]
        placed += (sliced.factors * noise.T).sum(1).T
        if moving is not None:  # The others are split as static Gaussians are.
            means = self.canonical.split_rows(rows, copies, generator)["means"].values
            placed = means.index_copy(0, moving, placed)
        children |= {"means": Rows(placed), "time_centers": replace(centers, values=times)}
        shrink = -math.log(SPLIT_SHRINK * copies)
        return _scaled(children, torch.full((len(placed),), shrink).to(placed))

    @torch.no_grad()
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """Isotropic rows at rest with low opacity, present for a fifth of the sequence each way."""
        children = dict(self.canonical.rows_at(points, colors, sizes, time))
        first, second = self._rotation.of_space(children["quats"].values)
        centers = second.new_full((len(points),), 0.5 if time is None else time)
        log_durations = torch.full_like(centers, math.log(NEW_DURATION))
        return {
            **children,
            "quats": Rows(first),
            **self.temporal_rows(
                {"time_quats": second, "time_centers": centers, "log_durations": log_durations},
                len(points),
            ),
        }

    @torch.no_grad()
    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """Relocation as for static Gaussians; scales along the fourth axis shrink too.

        Equation 9 of Kheradmand et al. 2024 preserves the opacity along any line through the
        centre, so it does in time.
        """
        children = dict(self.clone_rows(rows))
        still = self.canonical.relocated(rows, counts)
        shrunk = still["log_scales"].values - children["log_scales"].values
        children["opacity_logits"] = still["opacity_logits"]
        return _scaled(children, shrunk[:, 0])

    @torch.no_grad()
    def perturb_(self, rate: float, generator: torch.Generator, operators: Operators) -> None:
        """Add noise shaped by the slices' covariances to positions (see ``StaticGaussians``)."""
        means = self.canonical.means.values
        noise = torch.randn(means.shape, generator=generator, device=means.device).to(means)
        strength = noise_strengths(self.canonical.opacities())
        shaped = (self._with_standing(self._sliced().covariances) * noise[:, None]).sum(2)
        means.add_(shaped * (rate * strength)[:, None])

    def begin_(self, rows: Int[Tensor, " r"], times: Float[Tensor, " r"]) -> None:
        """Rows without motion, rotated in space alone, with the longest duration."""
        quats = self.canonical.quats.values
        first, second = self._rotation.of_space(quats[rows])
        quats[rows] = first
        self.write_temporal_("time_quats", rows, second)
        self.write_temporal_("time_centers", rows, times)
        self.write_temporal_("log_durations", rows, torch.full_like(times, math.log(MAX_DURATION)))


def _visible(opacities: Float[Tensor, " n"]) -> Bool[Tensor, " n"]:
    """True for rows that are opaque enough to be visible at a pixel."""
    return opacities >= DEFAULT.alpha_min


def _scaled(children: Children, log_factors: Float[Tensor, " r"]) -> Children:
    """Children with all four scales multiplied by a factor."""
    space, time = children["log_scales"].values, children["log_durations"]
    in_time = time.values + taken_rows(log_factors, moving_children(children))
    return {
        **children,
        "log_scales": Rows(space + log_factors[:, None]),
        "log_durations": replace(time, values=in_time),
    }
