"""Tracked Gaussians: static ones at every time, with a position and rotation of their own.

Luiten et al. 2024, "Dynamic 3D Gaussians: Tracking by Persistent Dynamic View Synthesis". The
canonical columns hold the current time, and are optimized; finished times are in a trajectory.
Scale, opacity and view-dependent colour are those of the first time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.batch import SEGMENTATION
from gsfw.core.cameras import Cameras
from gsfw.core.column import Column
from gsfw.core.context import StepContext
from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.rotations import relative_quaternions, same_half, unit_matrices
from gsfw.core.model import Children, DensifiableModel
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh, Splats
from gsfw.methods.dynamic3d.neighborhood import Neighborhood
from gsfw.methods.dynamic3d.rigidity import Neighbors, rigidity
from gsfw.methods.dynamic3d.segmentation import background_change
from gsfw.methods.dynamic3d.trajectory import Pose, Trajectory
from gsfw.methods.gaussians3d.model import StaticGaussians


@dataclass(frozen=True)
class Regularization:
    """Weights of the regularizers from the second time on."""

    rigid: float
    rotation: float
    isometry: float
    color: float
    background: float
    neighbors: int
    """Number of neighbours of each row."""
    neighbors_per_step: int
    """Number of them in the loss of a step."""


class TrackedGaussians(DensifiableModel):
    """Persistent rows: each is the same piece of surface at all times."""

    divisible = False  # Neighbours.

    def __init__(
        self,
        canonical: StaticGaussians,
        regularization: Regularization,
        operators: Operators,
        moving_colors: bool,
    ) -> None:
        """Start with static Gaussians, before the first time."""
        super().__init__()
        self._operators = operators
        self.canonical = canonical
        self._regularization = regularization
        self._moving_colors = moving_colors
        self.trajectory = Trajectory(self._pose())
        self._neighborhood: Neighborhood | None = None

    def columns(self) -> Mapping[str, Column]:
        """Columns of static Gaussians; past_means, past_quats, and past_colors if they change."""
        return {**self.canonical.columns(), **self.trajectory.columns()}

    def add_segmentation(self, rate: LearningRate) -> None:
        """Give each row a logit of the foreground: the column "segmentation"."""
        means = self.canonical.means.values
        column = Column(means.new_zeros(len(means), 1), rate)
        self.canonical.extra[SEGMENTATION] = column

    @property
    def _segmentation(self) -> Column | None:
        """The logits; ``None`` without masks."""
        return self.canonical.columns().get(SEGMENTATION)

    def foreground(self) -> Bool[Tensor, " n"] | None:
        """True for rows of the foreground; ``None`` without masks."""
        logits = self._segmentation
        return None if logits is None else logits.values.detach()[:, 0] >= 0

    def temporal_columns(self) -> Mapping[str, Column]:
        """The past columns: poses of the finished times."""
        return self.trajectory.columns()

    def _pose(self) -> Pose:
        """The current time."""
        rows = self.canonical
        colors = rows.sh_dc.values if self._moving_colors else None
        return Pose(rows.means.values, rows.quats.values, colors)

    @property
    def tracking(self) -> bool:
        """True after the first time."""
        return self.trajectory.num_finished > 0

    @torch.no_grad()
    def advance_(self, time: float) -> None:
        """Finish the current time, if there is one, and start ``time``.

        Positions and rotations start with the extrapolated motion of the last step in time
        (forward initialisation, section 3.2).
        """
        if self.trajectory.current is not None:
            self.trajectory.store(self._pose())
            self._move_on()
        self.trajectory.begin(time)

    def _move_on(self) -> None:
        """Start at x + R (x - x_prev) and q + (q - q_prev), the latter normalised.

        R is the row's own rotation since the previous time, so that bodies that turn stay on their
        circle; the paper has R = 1.
        """
        rows, count = self.canonical, self.trajectory.columns()["past_means"].values.shape[0]
        # As it was stored: its rounding must not look like a rotation.
        now = self.trajectory.stored(count - 1, rows.means.values)
        before = self.trajectory.stored(max(count - 2, 0), rows.means.values)
        previous = same_half(before.quats, now.quats)
        quats = 2 * now.quats - previous
        turned = unit_matrices(normalize(relative_quaternions(now.quats, previous), dim=1))
        shifts = torch.bmm(turned, (now.means - before.means)[:, :, None])[:, :, 0]
        rows.means.values.copy_(now.means + shifts)
        rows.quats.values.copy_(normalize(quats, dim=1))

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The Gaussians at ``time``, interpolated between times; at the first one for ``None``.

        Future times equal the current one.
        """
        still, current = self.canonical.splats(), self._pose()
        time = torch.zeros((), device=current.means.device) if time is None else time
        pose = self.trajectory.at(time, current)
        logits = self._segmentation
        extra = None if logits is None else logits.values.sigmoid()
        splats = replace(still, means=pose.means, quats=pose.quats, extra=extra)
        if pose.colors is None:
            return splats
        assert isinstance(still.colors, Sh)
        return replace(splats, colors=replace(still.colors, coefficients=pose.colors))

    def active_bands(self) -> int:
        """Active bands of the canonical Gaussians."""
        return self.canonical.active_bands()

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """From the second time on: rigidity among neighbours, changes of colours and background."""
        if not self.tracking:
            return {}
        weights, now = self._regularization, self._pose()
        before = self.trajectory.stored(self.trajectory.num_finished - 1, now.means)
        terms = self._rigidity(context, now, before)
        foreground = self.foreground()
        if foreground is not None:
            first = self.trajectory.stored(0, now.means)
            change = background_change(~foreground, now, first, context.extent)
            terms["background"] = weights.background * change
        if now.colors is not None and before.colors is not None:
            terms["color_change"] = weights.color * (now.colors - before.colors).abs().mean()
        return terms

    def _rigidity(self, context: StepContext, now: Pose, before: Pose) -> dict[str, Tensor]:
        """The terms of neighbours, among foreground rows only if there are masks."""
        weights, near = self._regularization, self._near()
        neighbors = self.neighbors(context.step)
        if len(neighbors.rows) == 0:
            return {}
        rigid, rotation, isometry = rigidity(
            neighbors, near.of(now.means), near.of(now.quats), near.of(before.quats)
        )
        return {
            "rigid": weights.rigid / context.extent * rigid,
            "rotation": weights.rotation * rotation,
            "isometry": weights.isometry / context.extent * isometry,
        }

    def neighbors(self, step: int) -> Neighbors:
        """The neighbours in the loss of a step of tracking.

        They are chosen before the step, which may be repeated with those of another.
        """
        return self._near().some(step, self.trajectory, self.canonical.means.values)

    def num_neighbors(self, step: int) -> int:
        """Number of neighbours of each row in the loss of a step; 0 at the first time."""
        return self._near().number(step) if self.tracking else 0

    def _near(self) -> Neighborhood:
        """The neighbours of each row, found once when the first time is finished."""
        if self._neighborhood is None or not self._neighborhood.fits(self.num_rows):
            weights, foreground = self._regularization, self.foreground()
            self._neighborhood = Neighborhood(
                self.trajectory,
                weights.neighbors,
                weights.neighbors_per_step,
                self._operators,
                None if foreground is None else foreground.nonzero()[:, 0],
            )
        return self._neighborhood

    def project_(self) -> None:
        """Clamp scales to their range."""
        self.canonical.project_()

    def summary(self) -> Mapping[str, int | float]:
        """Bytes of all that a render needs, and of the poses of other times in it."""
        found, stored = super().summary(), self.trajectory.num_bytes()
        return {**found, "model_bytes": found["model_bytes"] + stored, "stored_bytes": stored}

    # For density control, on the current time. Stored poses follow the rows.

    def opacities(self) -> Float[Tensor, " n"]:
        """Opacity of each row in [0, 1], the same at all times."""
        return self.canonical.opacities()

    def sizes(self) -> Float[Tensor, " n"]:
        """Largest standard deviation of each row, in scene units, the same at all times."""
        return self.canonical.sizes()

    @torch.no_grad()
    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Smaller children at points of the row's own Gaussian, on its path."""
        children = self.clone_rows(rows.repeat(copies))
        return {**children, **self.canonical.split_rows(rows, copies, generator)}

    @torch.no_grad()
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """Isotropic rows with low opacity, at ``points`` at all finished times."""
        fresh = self.canonical.rows_at(points, colors, sizes, time)
        constant = fresh["sh_dc"].values if self._moving_colors else None
        pose = Pose(fresh["means"].values, fresh["quats"].values, constant)
        return {**fresh, **self.trajectory.at_rest(pose)}

    @torch.no_grad()
    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """``rows`` with the opacity and scale with which ``counts`` copies render as one did."""
        return {**self.clone_rows(rows), **self.canonical.relocated(rows, counts)}

    def perturb_(self, rate: float, generator: torch.Generator, operators: Operators) -> None:
        """Add noise to positions of rows with low opacity, at the first time."""
        if not self.tracking:
            self.canonical.perturb_(rate, generator, operators)

    def change_opacities_(self, function: Callable[[Tensor], Tensor]) -> tuple[str, ...]:
        """Change every opacity by a function, in place."""
        return self.canonical.change_opacities_(function)
