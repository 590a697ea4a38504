"""Rows: a divided model as refiners see it, with the rows of all processes.

Facts by row are gathered; new rows are made where their parents are. Random numbers come from one
generator for each shard of the rows, so that any number of processes draws the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NoReturn

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column
from gsfw.core.errors import ConfigError
from gsfw.core.model import Children, DensifiableModel
from gsfw.core.operators import Operators
from gsfw.core.splats import Splats
from gsfw.parallel.sharded.new_rows import NewRows, joined
from gsfw.parallel.sharded.team import GaussianParallel
from gsfw.parallel.sharded.window import Window

SEEDS = 2**62
"""Seeds of the generators of shards lie below."""


class ShardedRows(DensifiableModel):
    """All rows of a model that is divided among processes."""

    def __init__(self, own: DensifiableModel, team: GaussianParallel) -> None:
        """Look at all rows.

        Args:
            own: the model with the rows of this process.
            team: the processes.
        """
        super().__init__()
        self._models, self._team = [own], team  # In a list, it is no module of this one.

    @property
    def _own(self) -> DensifiableModel:
        return self._models[0]

    @property
    def num_rows(self) -> int:
        """Number of rows of all processes."""
        return self._team.num_rows

    def columns(self) -> Mapping[str, Column]:
        """Not known: no process has them whole.

        Raises:
            ConfigError: always.
        """
        self._refuse("the columns")

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """Not known: no process has them all.

        Raises:
            ConfigError: always.
        """
        self._refuse("the splats")

    @staticmethod
    def _refuse(what: str) -> NoReturn:
        raise ConfigError(
            f"a refiner reads {what} of a model whose rows are divided among processes.",
            "Train with shards=0, or with strategy=adc or strategy=mcmc; give strategy.budget as a "
            "number of Gaussians.",
        )

    # Facts by row.

    def opacities(self) -> Float[Tensor, " n"]:
        """Opacity of each row."""
        return self._team.all_rows(self._own.opacities())

    def sizes(self) -> Float[Tensor, " n"]:
        """Largest standard deviation of each row."""
        return self._team.all_rows(self._own.sizes())

    def positions(self) -> Float[Tensor, "n 3"] | None:
        """Position of each row."""
        own = self._own.positions()
        return None if own is None else self._team.all_rows(own)

    def lifetimes(self) -> Float[Tensor, " n"] | None:
        """Mean temporal weight of each row."""
        own = self._own.lifetimes()
        return None if own is None else self._team.all_rows(own)

    def time_gradients(self) -> Float[Tensor, " n"] | None:
        """Gradient by the temporal centre of each row."""
        own = self._own.time_gradients()
        return None if own is None else self._team.all_rows(own)

    # New rows.

    @torch.no_grad()
    def clone_rows(
        self, rows: Int[Tensor, " r"], generator: torch.Generator | None = None
    ) -> Children:
        """Copies of rows."""

        def cloned(own: Tensor, places: Tensor, seeded: torch.Generator | None) -> Children:
            return self._own.clone_rows(own, seeded)

        return self._by_shard(rows, 1, cloned, generator)

    @torch.no_grad()
    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Smaller children of rows."""

        def split(own: Tensor, places: Tensor, seeded: torch.Generator | None) -> Children:
            assert seeded is not None
            return self._own.split_rows(own, copies, seeded)

        return self._by_shard(rows, copies, split, generator)

    @torch.no_grad()
    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """Rows that render as one did with as many copies as ``counts`` says."""

        def moved(own: Tensor, places: Tensor, seeded: torch.Generator | None) -> Children:
            return self._own.relocated(own, counts[places])

        return self._by_shard(rows, 1, moved, None)

    @torch.no_grad()
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """New rows at points, of which every process makes some."""
        team, count = self._team, len(points)
        own = team.division.rows_of(team.rank, count)
        some = slice(own.start, own.stop)
        rows = self._own.rows_at(points[some], colors[some], sizes[some], time)
        return NewRows(count, torch.arange(own.start, own.stop, device=points.device), rows)

    def _by_shard(
        self,
        rows: Int[Tensor, " r"],
        copies: int,
        make: Callable[[Tensor, Tensor, torch.Generator | None], Children],
        generator: torch.Generator | None,
    ) -> NewRows:
        """New rows from those that this process has, shard by shard.

        Args:
            rows: the parents, among the rows of all processes.
            copies: children of each: the first child of every row, then the second ones.
            make: returns the children, of parents among the rows of this process, which have these
                places among ``rows``, by the random numbers of a shard.
            generator: the same in all processes; ``None`` without random numbers.
        """
        first, places, found = self._team.own_rows.start, [], []
        numbers = torch.arange(copies, device=rows.device)[:, None]
        for shard, seeded in self._seeded(generator):
            chosen = ((rows >= shard.start) & (rows < shard.stop)).nonzero()[:, 0]
            found.append(make(rows[chosen] - first, chosen, seeded))
            places.append((numbers * len(rows) + chosen).flatten())
        children = joined(found, self._own.columns())
        return NewRows(copies * len(rows), torch.cat(places), children)

    def _seeded(
        self, generator: torch.Generator | None
    ) -> Iterator[tuple[range, torch.Generator | None]]:
        """The rows of each shard of this process, with a generator of its own."""
        team = self._team
        seed = 0
        if generator is not None:
            device = generator.device
            seed = int(torch.randint(SEEDS, (), generator=generator, device=device))
        for shard in team.division.shards_of(team.rank):
            rows = range(
                team.division.start(shard, self.num_rows),
                team.division.start(shard + 1, self.num_rows),
            )
            own = None
            if generator is not None:
                own = torch.Generator(generator.device).manual_seed(seed + shard)
            yield rows, own

    # Changes in place.

    @torch.no_grad()
    def perturb_(self, rate: float, generator: torch.Generator, operators: Operators) -> None:
        """Move positions by noise, shard by shard."""
        first = self._team.own_rows.start
        for shard, seeded in self._seeded(generator):
            assert seeded is not None
            with Window(self._own, shard.start - first, shard.stop - first).shown():
                self._own.perturb_(rate, seeded, operators)

    @torch.no_grad()
    def change_opacities_(self, function: Callable[[Tensor], Tensor]) -> tuple[str, ...]:
        """Apply a function to every opacity."""
        return self._own.change_opacities_(function)
