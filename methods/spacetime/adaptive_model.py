"""Spacetime Gaussians, each with only the temporal parameters that it needs."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column, Layout, Rows
from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.ragged import row_offsets
from gsfw.core.model import Children
from gsfw.core.splats import Splats
from gsfw.core.table import SplatTable
from gsfw.methods.spacetime.model import SpacetimeGaussians, presence
from gsfw.methods.spacetime.places import Places
from gsfw.methods.spacetime.polynomial import displacement, recentered

MIDDLE = 0.5
"""Origin of time for permanent rows, which have no centre."""


@dataclass(frozen=True)
class _CountedPlaces:
    """Places of a column, the offsets that they are of, and the number of others before them."""

    offsets: Tensor
    places: Places
    number: int


class AdaptiveSpacetimeGaussians(SpacetimeGaussians):
    """Spacetime Gaussians whose temporal columns are all ragged, independently of each other.

    ``motion`` has one value [3] for each power of a row's polynomial, at most ``order``; all other
    columns have one or none. ``time_centers`` and ``log_durations`` have values for the same rows:
    the temporary ones.
    """

    def temporal_column(self, values: Float[Tensor, "n ..."], rate: LearningRate) -> Column:
        """A column with full values for all moving rows."""
        flat, each = (values.flatten(0, 1), values.shape[1]) if values.dim() == 3 else (values, 1)
        moves = torch.ones(len(values), dtype=torch.bool)
        if self.still is not None:
            moves = ~self.still.mask()
        lengths = each * moves.long()
        moving = flat[moves.repeat_interleave(each)]
        return Column(moving, rate, Layout.RAGGED, row_offsets(lengths))

    # Columns of each row.

    def rows_version(self) -> Hashable:
        """A value that differs once rows have other temporal parameters."""
        counts = tuple(self._counted_places(name).number for name in self.temporal)
        return super().rows_version(), counts

    def places(self, name: str) -> Places:
        """Rows of the values of a temporal column."""
        return self._counted_places(name).places

    def _counted_places(self, name: str) -> _CountedPlaces:
        offsets = self._column(name).offsets
        assert offsets is not None
        # Offsets are replaced, never changed: only then does a GPU count again, and the host wait.
        known = self._known_places.get(name)
        if known is None or known.offsets is not offsets:
            number = 0 if known is None else known.number + 1
            known = _CountedPlaces(offsets, Places.of(offsets.diff()), number)
            self._known_places[name] = known
        return known

    @property
    def _known_places(self) -> dict[str, _CountedPlaces]:
        """Places by column; no part of the state."""
        known: dict[str, _CountedPlaces] = self.__dict__.setdefault("_places_by_name", {})
        return known

    def lengths(self, name: str) -> Int[Tensor, " n"]:
        """Number of values of each row in a temporal column; for ``motion``, its order."""
        offsets = self._column(name).offsets
        assert offsets is not None
        return offsets.diff()

    def whole(self, name: str) -> int:
        """Largest number of values of a row in a temporal column."""
        return self.order if name == "motion" else 1

    def everywhere(self, values: Float[Tensor, " m"], otherwise: float) -> Float[Tensor, " n"]:
        """Expand values of the temporary rows to all rows; permanent rows get another value."""
        count = len(self.canonical.means.values)
        if len(values) == count:
            return values
        everywhere = values.new_full((count,), otherwise)
        return everywhere.index_copy(0, self.places("time_centers").rows, values)

    def centers(self) -> Float[Tensor, " n"]:
        """Origin of time of each row; without gradient."""
        return self.everywhere(self._column("time_centers").values.detach(), MIDDLE)

    def paths(self) -> Float[Tensor, "n k 3"]:
        """Motion coefficients of all rows, zero above the order of each."""
        motion = self._column("motion").values.detach()
        return self.places("motion").padded(motion, self.num_rows, self.order)

    def turning(self) -> dict[str, Tensor]:
        """Trained values that change at a rate, by the name of the column with the rate."""
        found = {"spins": self.canonical.quats.values} if "spins" in self.temporal else {}
        return found if self.features is None else {**found, "feature_rates": self.features.values}

    # Rendering.

    @property
    def selects(self) -> bool:
        """False: all rows are rendered."""
        return False

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """All Gaussians at ``time``; at 0, where a file begins, for ``None``."""
        centers = self.centers()
        time = centers.new_zeros(()) if time is None else time.to(centers)
        still, elapsed = self.canonical.splats(), time - centers
        assert still.quats is not None
        quats, extra = still.quats, still.extra
        if "spins" in self.temporal:
            quats = self._turned(quats, "spins", elapsed)
        if self.features is not None:
            features = self.features.values
            changing = self._turned(torch.zeros_like(features), "feature_rates", elapsed)
            extra = torch.cat([features, changing], dim=1)
        weights = self.everywhere(self._weights(time), otherwise=1.0)
        return replace(
            still,
            means=self._moved(still.means, elapsed),
            opacities=still.opacities * weights,
            quats=quats,
            extra=extra,
        )

    def _moved(self, means: Float[Tensor, "n 3"], elapsed: Float[Tensor, " n"]) -> Tensor:
        """Positions at some time from the centres, added up value by value."""
        values, places = self._column("motion").values, self.places("motion")
        if len(values) == len(means) * self.order:  # As long as no row has lost a value: faster.
            return means + displacement(values.view(-1, self.order, 3), elapsed)
        elapsed = elapsed.index_select(0, places.rows)
        powers = elapsed
        for higher in range(1, self.order):
            powers = torch.where(places.within >= higher, powers * elapsed, powers)
        return means.index_add(0, places.rows, values * powers[:, None])

    def _turned(
        self, values: Float[Tensor, "n d"], name: str, elapsed: Float[Tensor, " n"]
    ) -> Float[Tensor, "n d"]:
        """Values of all rows; add the change of rows with a rate."""
        rates, rows = self._column(name).values, self.places(name).rows
        if len(rates) == len(values):
            return values + rates * elapsed[:, None]
        return values.index_add(0, rows, rates * elapsed.index_select(0, rows)[:, None])

    # Rows.

    def spread(self, children: Children, generator: torch.Generator) -> Children:
        """Children on the same paths; temporary ones get temporal centres of their own."""
        changed, (shifts, centers) = dict(children), _new_centers(children, generator)
        places, motion = _places(children["motion"]), children["motion"].values
        paths = places.padded(motion, len(shifts), self.order)
        changed["time_centers"] = replace(children["time_centers"], values=centers)
        moved = places.packed(recentered(paths, shifts))
        changed["motion"] = replace(children["motion"], values=moved)
        changed["means"] = Rows(children["means"].values + displacement(paths, shifts))
        if "spins" in children:
            rows, spins = _places(children["spins"]).rows, children["spins"].values
            turned = children["quats"].values.index_add(0, rows, spins * shifts[rows, None])
            changed["quats"] = Rows(turned)
        return changed

    def temporal_rows(self, values: Mapping[str, Tensor], count: int) -> Children:
        """Temporal values of ``count`` new rows, with all optional parameters."""
        ones = torch.ones(count, dtype=torch.int64, device=self.canonical.means.values.device)
        rows = {
            name: Rows(new.repeat_interleave(self.whole(name), dim=0), self.whole(name) * ones)
            for name, new in values.items()
        }
        return rows if self.still is None else {**rows, **self.still.moving_rows(ones)}

    def _resize(self, table: SplatTable, rows: Int[Tensor, " r"], *, moves: bool) -> None:
        assert self.still is not None
        still = self.still.mask()
        still[rows] = not moves
        for name in self.temporal_columns():
            lengths = self.lengths(name).clone()
            lengths[rows] = self.whole(name) if moves else 0
            table.resize(name, lengths)
        table.resize("stillness", still.long())
        table.reset_rows(rows)

    def census(self) -> dict[str, int]:
        """Number of rows with each temporal parameter, their floats, and the full number."""
        columns = self.temporal_columns()
        orders = self.lengths("motion").bincount(minlength=self.order + 1).tolist()
        found = {f"rows_of_order_{order}": count for order, count in enumerate(orders)}
        found["rows_always_there"] = self.num_rows - len(columns["time_centers"].values)
        if "spins" in columns:
            found["rows_that_turn"] = len(columns["spins"].values)
        sizes = {name: column.values.shape[1:].numel() for name, column in columns.items()}
        found["time_floats"] = sum(column.values.numel() for column in columns.values())
        found["time_floats_full"] = self.num_rows * sum(
            self.whole(name) * size for name, size in sizes.items()
        )
        return found

    def summary(self) -> Mapping[str, int | float]:
        """Sizes, the number of static rows, and the number of rows with each temporal parameter."""
        return {**super().summary(), **self.census()}


def _places(rows: Rows) -> Places:
    assert rows.lengths is not None
    return Places.of(rows.lengths)


def _new_centers(
    children: Children, generator: torch.Generator
) -> tuple[Float[Tensor, " r"], Float[Tensor, " m"]]:
    """Shift of the temporal centres of new rows, zero for those without one; and the centres."""
    old = children["time_centers"]
    new = presence(old.values, children["log_durations"].values).draw(generator)
    shifts = new.new_zeros(len(children["means"].values))
    return shifts.index_copy(0, _places(old).rows, new - old.values), new
