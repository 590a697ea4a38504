"""Table: edits of the rows of a divided model, after which every process has its share again."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsfw.core.column import Rows
from gsfw.core.errors import ConfigError
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import Children, PrimitiveModel
from gsfw.core.operators import AdamMoments
from gsfw.core.table import SplatTable
from gsfw.parallel.sharded.new_rows import NewRows
from gsfw.parallel.sharded.state import by_row
from gsfw.parallel.sharded.team import GaussianParallel

PLACE = ":place"
"""The name under which rows take their place along; no column has it."""


class ShardedTable(SplatTable):
    """The rows of all processes: an edit brings each row to the process of its new place."""

    def __init__(self, model: PrimitiveModel, optimizer: Optimizer, team: GaussianParallel) -> None:
        """Edit the rows of a model of which this process has its share.

        Args:
            model: has the rows of this process.
            optimizer: has their moments.
            team: the processes.
        """
        super().__init__(model, optimizer)
        self._team = team

    def __len__(self) -> int:
        return self._team.num_rows

    @torch.no_grad()
    def edit(
        self, keep: Bool[Tensor, " n"] | Int[Tensor, " r"] | None, children: Children | None
    ) -> None:
        """Keep some of all rows, then add ``children``."""
        team, count = self._team, len(self)
        if keep is None:
            keep = torch.arange(count, device=self.device)
        if keep.dtype == torch.bool and len(keep) != count:
            raise ValueError(f"a mask of {len(keep)} rows for {count}")
        kept = keep.nonzero()[:, 0] if keep.dtype == torch.bool else keep
        places = torch.full((count,), -1, device=self.device)
        places[kept] = torch.arange(len(kept), device=self.device)
        places = places[team.own_rows.start : team.own_rows.stop]
        stays = (places >= 0).nonzero()[:, 0]
        new = None if children is None else self._new(children)
        total = len(kept) + (0 if new is None else new.count)
        targets = places[stays]
        if new is not None:
            targets = torch.cat([targets, len(kept) + new.places])
        found = self._delivered(self._own_after(stays, new), targets, total)
        team.num_rows = total
        order = found.pop(PLACE).argsort()
        for name, column in self._model.columns().items():
            column.assign(Rows(by_row(column, found[name].index_select(0, order)).contiguous()))
            if column.trained:
                states = self._optimizer.moments(name)
                self._optimizer.replace_moments(
                    name,
                    [
                        AdamMoments(
                            by_row(
                                column, found[f"{name}:first"].index_select(0, order)
                            ).contiguous(),
                            by_row(
                                column, found[f"{name}:second"].index_select(0, order)
                            ).contiguous(),
                            state.count,
                        )
                        for state in states
                    ],
                )
        self.row_edits += 1

    def _own_after(self, stays: Int[Tensor, " r"], new: NewRows | None) -> dict[str, Tensor]:
        """Values and moments of the rows of this process that stay, then of its new ones."""
        found = {}
        for name, column in self._model.columns().items():
            values = column.values.detach()
            stored = {name: values}
            if column.trained:
                (state,) = self._optimizer.moments(name)
                stored |= {f"{name}:first": state.first, f"{name}:second": state.second}
            for key, tensor in stored.items():
                rows = column.take(stays, tensor)
                if new is not None:
                    fresh = new.rows[name] if key == name else Rows.zeros_like(new.rows[name])
                    rows = column.join(rows, fresh)
                found[key] = by_row(column, rows.values)
        return found

    def _delivered(
        self, rows: dict[str, Tensor], targets: Int[Tensor, " r"], total: int
    ) -> dict[str, Tensor]:
        """Rows in the processes that have their places among ``total``, with these places."""
        division = self._team.division
        ends = [division.rows_of(rank, total).stop for rank in range(division.size)]
        owners = torch.searchsorted(torch.tensor(ends, device=targets.device), targets, right=True)
        return self._team.deliver({**rows, PLACE: targets}, owners)

    @torch.no_grad()
    def replace(self, rows: Int[Tensor, " r"], children: Children) -> None:
        """Overwrite some of all rows in place."""
        new, columns = self._new(children), self._model.columns()
        sent = {name: by_row(columns[name], new.rows[name].values) for name in columns}
        found = self._delivered(sent, rows[new.places], len(self))
        own = found.pop(PLACE) - self._team.own_rows.start
        for name, column in columns.items():
            column.write(own, Rows(by_row(column, found[name]).contiguous()))
        super().reset_rows(own)
        self.row_edits += 1

    def joined(self, first: Children, second: Children) -> Children:
        """The new rows of ``first``, then those of ``second``."""
        return self._new(second).after(self._new(first), self._model.columns())

    def reset_rows(self, rows: Int[Tensor, " r"]) -> None:
        """Set the moments of some of all rows to zero."""
        own = self._team.own_rows
        super().reset_rows(rows[(rows >= own.start) & (rows < own.stop)] - own.start)

    def resize(self, name: str, lengths: Int[Tensor, " n"]) -> None:
        """Not done: ragged columns are not divided."""
        raise ConfigError(
            f"the column {name!r} has rows of different lengths, and is divided among processes.",
            "Train with shards=0.",
        )

    def _new(self, children: Children) -> NewRows:
        """Children of a divided model.

        Raises:
            ConfigError: a refiner has made them itself.
        """
        if isinstance(children, NewRows):
            self._check(children.rows)
            return children
        raise ConfigError(
            "a refiner has made rows of its own for a model that is divided among processes.",
            "Train with shards=0, or with strategy=adc or strategy=mcmc.",
        )
