"""MovingGaussians: canonical Gaussians, all or some of which change with time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Mapping

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.ragged import row_offsets
from gsfw.core.model import Children, DensifiableModel
from gsfw.core.operators import Operators
from gsfw.core.splats import Splats
from gsfw.core.table import SplatTable
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.moving.still_rows import StillRows


class MovingGaussians(DensifiableModel):
    """Static Gaussians, ``canonical``, and their changes with time.

    A derived model has ``temporal_columns`` and ``splats``; for motion that belongs to no row, such
    as a network, ``parameter_groups`` too. Density control treats rows as static Gaussians: new
    rows copy the temporal values of their parents, or have zeros. Zeros should therefore mean no
    change; a model with other needs overrides ``split_rows``, ``rows_at`` and ``begin_``.

    With ``still`` only some rows change. These have values in the temporal columns, which are then
    ragged, one each and in order; the others are rendered in canonical space. Without it all rows
    change, and temporal columns are dense.
    """

    def __init__(self, canonical: StaticGaussians, still: StillRows | None) -> None:
        """Store the Gaussians; temporal columns are made afterwards, with ``temporal_column``.

        Args:
            canonical: the Gaussians before any change, of ``MovingMethod.canonical``.
            still: mask of static rows, of ``MovingMethod.still_rows``; ``None``: all rows change.
        """
        super().__init__()
        self.canonical, self.still = canonical, still

    @abstractmethod
    def temporal_columns(self) -> Mapping[str, Column]:
        """Temporal columns of the rows that change, by name; {} if no motion belongs to rows."""

    def begin_(self, rows: Int[Tensor, " r"], times: Float[Tensor, " r"]) -> None:
        """Start rows that were static until now: with a constant path, always present.

        In place, without a change of the image. Their temporal values are zero, and stay so where
        zeros mean no change.

        Args:
            rows: some of the rows that change now, in order.
            times: time at which each row is needed the most.
        """

    def end_(self, rows: Int[Tensor, " r"]) -> None:
        """Average other temporal parameters, such as colours, of rows that become static. In place.

        Args:
            rows: some of those that change, in order.
        """

    def columns(self) -> Mapping[str, Column]:
        """Columns of static Gaussians, temporal columns, and the columns of ``still``."""
        still = {} if self.still is None else self.still.columns()
        return {**self.canonical.columns(), **self.temporal_columns(), **still}

    def temporal_column(self, values: Float[Tensor, "n ..."], rate: LearningRate) -> Column:
        """A temporal column with values of all rows, or of none if all are static."""
        if self.still is None:
            return Column(values, rate)
        moves = ~self.still.mask()
        return Column(values[moves], rate, Layout.RAGGED, row_offsets(moves.long()))

    @property
    def changing(self) -> bool:
        """True if any row changes with time at this step; false in a phase without motion."""
        return True

    @property
    def selects(self) -> bool:
        """True if only visible rows become splats, for whose number the host waits."""
        return False

    def active_bands(self) -> int:
        """Active bands of the canonical Gaussians."""
        return self.canonical.active_bands()

    # Which rows change.

    def moving(self) -> Int[Tensor, " m"] | None:
        """Rows that change with time, in the order of temporal values; ``None`` for all."""
        return None if self.still is None else self.still.moving()

    def rows_version(self) -> Hashable:
        """A value that differs once other rows change with time; the host then waits for a GPU."""
        return None if self.still is None else self.still.version()

    def taken(self, values: Float[Tensor, "n ..."]) -> Float[Tensor, "m ..."]:
        """Select the values of the rows that change."""
        return taken_rows(values, self.moving())

    def everywhere(self, values: Float[Tensor, " m"], otherwise: float) -> Float[Tensor, " n"]:
        """Expand values of the rows that change to all rows; static rows get ``otherwise``."""
        rows = self.moving()
        if rows is None:
            return values
        return values.new_full((self.num_rows,), otherwise).index_copy(0, rows, values)

    def moved(
        self, values: Float[Tensor, "n ..."], change: Float[Tensor, "m ..."]
    ) -> Float[Tensor, "n ..."]:
        """Add something to the values of the rows that change."""
        rows = self.moving()
        return values + change if rows is None else values.index_add(0, rows, change)

    @torch.no_grad()
    def stop_(self, table: SplatTable, rows: Int[Tensor, " r"], at_rest: Splats) -> None:
        """Make rows static from now on, with the parameters of ``at_rest``."""
        self.end_(rows)
        canonical, scales = self.canonical, at_rest.scales
        assert scales is not None
        assert at_rest.quats is not None
        canonical.means.values[rows] = at_rest.means
        canonical.quats.values[rows] = at_rest.quats
        canonical.log_scales.values[rows] = scales.log()
        canonical.opacity_logits.values[rows] = at_rest.opacities.logit()
        self._resize(table, rows, moves=False)

    @torch.no_grad()
    def start_(
        self, table: SplatTable, rows: Int[Tensor, " r"], times: Float[Tensor, " r"]
    ) -> None:
        """Let static rows change from now on; at first they keep their values."""
        assert self.still is not None
        self._resize(table, rows, moves=True)
        self.still.extend_(rows)
        self.begin_(rows, times)

    def _resize(self, table: SplatTable, rows: Int[Tensor, " r"], *, moves: bool) -> None:
        assert self.still is not None
        still = self.still.mask()
        still[rows] = not moves
        for name in self.temporal_columns():
            table.resize(name, (~still).long())
        table.resize("stillness", still.long())
        table.reset_rows(rows)

    def write_temporal_(self, name: str, rows: Int[Tensor, " r"], values: Tensor) -> None:
        """Overwrite a temporal value of rows that change."""
        self.temporal_columns()[name].write(rows, Rows(values, torch.ones_like(rows)))

    # New rows.

    def temporal_rows(self, values: Mapping[str, Tensor], count: int) -> Children:
        """Temporal values of ``count`` new moving rows, and their values of ``still``."""
        if self.still is None:
            return {name: Rows(rows) for name, rows in values.items()}
        lengths = torch.ones(count, dtype=torch.int64, device=self.canonical.means.values.device)
        moving = {name: Rows(rows, lengths) for name, rows in values.items()}
        return {**moving, **self.still.moving_rows(lengths)}

    @torch.no_grad()
    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Smaller children at points of each row's canonical Gaussian, with its temporal values."""
        smaller = self.canonical.split_rows(rows, copies, generator)
        return {**self.clone_rows(rows.repeat(copies)), **smaller}

    @torch.no_grad()
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """Isotropic rows of low opacity, with temporal values of zero."""
        fresh, count = self.canonical.rows_at(points, colors, sizes, time), len(points)
        values = {
            name: column.values.new_zeros(count, *column.values.shape[1:])
            for name, column in self.temporal_columns().items()
        }
        return {**fresh, **self.temporal_rows(values, count)}

    # The same for all models whose changes with time leave these alone.

    def opacities(self) -> Float[Tensor, " n"]:
        """Canonical opacity of each row in [0, 1]."""
        return self.canonical.opacities()

    def project_(self) -> None:
        """Clamp the canonical Gaussians to their range."""
        self.canonical.project_()

    def summary(self) -> Mapping[str, int | float]:
        """Sizes, and the number of static rows."""
        if self.still is None:
            return super().summary()
        static = len(self.still.rows())
        rows = max(self.num_rows, 1)
        counts = {"static_rows": static, "moving_rows": self.num_rows - static}
        return {**super().summary(), **counts, "static_share": round(static / rows, 4)}

    def sizes(self) -> Float[Tensor, " n"]:
        """Largest canonical standard deviation of each row, in scene units."""
        return self.canonical.sizes()

    @torch.no_grad()
    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """Relocation as for static Gaussians; coincident copies also share path and time."""
        return {**self.clone_rows(rows), **self.canonical.relocated(rows, counts)}

    def perturb_(self, rate: float, generator: torch.Generator, operators: Operators) -> None:
        """Add noise shaped by canonical covariances to canonical positions."""
        self.canonical.perturb_(rate, generator, operators)

    def change_opacities_(self, function: Callable[[Tensor], Tensor]) -> tuple[str, ...]:
        """Change every canonical opacity by a function, in place."""
        return self.canonical.change_opacities_(function)


def taken_rows(
    values: Float[Tensor, "n ..."], rows: Int[Tensor, " m"] | None
) -> Float[Tensor, "m ..."]:
    """Select the values of some rows; ``None`` for all."""
    return values if rows is None else values.index_select(0, rows)


def moving_children(children: Children) -> Int[Tensor, " m"] | None:
    """Rows among new rows that change with time; ``None`` for all.

    The column of ``StillRows`` tells, which every model with static rows has.
    """
    stillness = children.get("stillness")
    if stillness is None:
        return None
    assert stillness.lengths is not None
    return (stillness.lengths == 0).nonzero()[:, 0]


def added(children: Children, name: str, change: Float[Tensor, "m d"]) -> Float[Tensor, "r d"]:
    """A canonical value of new rows, with ``change`` added to those that change with time."""
    values, rows = children[name].values, moving_children(children)
    return values + change if rows is None else values.index_add(0, rows, change)
