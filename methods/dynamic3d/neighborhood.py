"""Neighborhood: rows that should move together, by their positions at the first time."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.operators import Operators
from gsfw.methods.dynamic3d.rigidity import Neighbors
from gsfw.methods.dynamic3d.trajectory import Trajectory


class Neighborhood:
    """The nearest rows of each row at the first time, and their distances.

    It follows from the trajectory, so it is no part of the state. Weights are exp(-(d / m)^2)
    with m the row's own median distance: the paper's exp(-2000 d^2) is for a capture in metres
    whose Gaussians are centimetres apart, and would disconnect those of a coarse background.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        count: int,
        per_step: int,
        operators: Operators,
        members: Int[Tensor, " m"] | None = None,
    ) -> None:
        """Find the ``count`` nearest rows of each row; a step uses ``per_step`` of them.

        With ``members``, only these rows are neighbours of each other; the others take no part, and
        "row i" of all results is row ``members[i]``.
        """
        self._members = members
        every = trajectory.stored(0, trajectory.columns()["past_means"].values).means
        self._num_rows, first = len(every), self.of(every)
        self._rows = operators.neighbors(first, min(count, max(len(first) - 1, 1)))
        self._lengths = _offsets(first, self._rows).norm(dim=2)
        typical = self._lengths.median(dim=1, keepdim=True).values
        nearness = torch.exp(-((self._lengths / typical.clamp_min(1e-12)) ** 2))
        # With too few other rows a row is its own neighbour, which has no effect.
        own = torch.arange(len(first), device=first.device)[:, None]
        self._weights = torch.where(self._rows == own, 0.0, nearness)
        # Order of the neighbours in the steps of the current time.
        self._num_turns = -(-self._rows.shape[1] // per_step)
        self._finished, self._turns = 0, dict[int, Neighbors]()
        self._stays = operators.fixed_shapes
        self._places: dict[int, Neighbors] = {}
        """The places at which steps read so many neighbours, if they stay there."""
        self._placed: tuple[int, int] | None = None
        """Finished times and turn of the neighbours that are there now."""

    def fits(self, num_rows: int) -> bool:
        """True if this belongs to a model with so many rows."""
        return self._num_rows == num_rows

    def of(self, values: Float[Tensor, "n d"]) -> Float[Tensor, "m d"]:
        """Values of the rows that take part; differentiable."""
        return values if self._members is None else values.index_select(0, self._members)

    def number(self, step: int) -> int:
        """Number of neighbours of each row in ``some``."""
        return len(range(self._rows.shape[1])[self._chosen(step)])

    def some(self, step: int, trajectory: Trajectory, like: Tensor) -> Neighbors:
        """Some neighbours of each row; later steps use others until all were used.

        Where steps have fixed shapes, all steps with as many neighbours read them at one place.
        Asking again for those of the same step changes nothing there.
        """
        turn = self._turn(step, trajectory, like)
        if not self._stays:
            return turn
        number, placed = turn.rows.shape[1], (self._finished, step % self._num_turns)
        if number not in self._places:
            self._places[number] = Neighbors(*(tensor.clone() for tensor in _tensors(turn)))
        elif placed != self._placed:
            torch._foreach_copy_(_tensors(self._places[number]), _tensors(turn))
        self._placed = placed
        return self._places[number]

    def _chosen(self, step: int) -> slice:
        return slice(step % self._num_turns, None, self._num_turns)

    def _turn(self, step: int, trajectory: Trajectory, like: Tensor) -> Neighbors:
        """The neighbours of a step, worked out once for each time."""
        if self._finished != trajectory.num_finished:
            self._finished = trajectory.num_finished
            self._turns.clear()
        turn = step % self._num_turns
        if turn not in self._turns:
            chosen = self._chosen(step)
            rows = self._rows[:, chosen].contiguous()
            previous = self.of(trajectory.stored(self._finished - 1, like).means)
            self._turns[turn] = Neighbors(
                rows,
                self._weights[:, chosen].to(like),
                _offsets(previous, rows),
                self._lengths[:, chosen].to(like),
            )
        return self._turns[turn]


def _tensors(neighbors: Neighbors) -> list[Tensor]:
    return [neighbors.rows, neighbors.weights, neighbors.previous, neighbors.lengths]


def _offsets(points: Float[Tensor, "n 3"], rows: Int[Tensor, "n k"]) -> Float[Tensor, "n k 3"]:
    return points.index_select(0, rows.flatten()).view(*rows.shape, 3) - points[:, None]
