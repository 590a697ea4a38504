"""Window: a model that has the rows of one shard for a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import torch
from torch import Tensor

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.model import PrimitiveModel


class Window:
    """Successive rows of a model, with gradients of their own.

    Within ``shown`` all columns of the model have these rows alone. Gradients arrive in the window,
    and ``add_gradients`` adds them to those of the model's parameters.
    """

    def __init__(self, model: PrimitiveModel, start: int, stop: int) -> None:
        """Look at the rows ``start`` to ``stop``; no copy."""
        self.start, self.stop = start, stop
        self._columns = model.columns()
        self._rows: dict[str, Rows] = {}
        for name, column in self._columns.items():
            rows = column.slice(start, stop)
            wants = column.trained and torch.is_grad_enabled()
            self._rows[name] = Rows(rows.values.requires_grad_(wants), rows.lengths)

    @property
    def count(self) -> int:
        """Number of its rows."""
        return self.stop - self.start

    @contextmanager
    def shown(self) -> Iterator[None]:
        """The model has the rows of this window, within."""
        with ExitStack() as stack:
            for name, column in self._columns.items():
                stack.enter_context(column.standing_for(self._rows[name]))
            yield

    @torch.no_grad()
    def add_gradients(self) -> None:
        """Add the gradients of these rows to those of the model, and forget them."""
        for name, column in self._columns.items():
            gradient = self._rows[name].values.grad
            if gradient is None:
                continue
            self._rows[name].values.grad = None
            if column.values.grad is None and gradient.shape == column.values.shape:
                column.values.grad = gradient.add_(0.0)  # As below, -0 becomes 0.
                continue
            if column.values.grad is None:
                column.values.grad = torch.zeros_like(column.values)
            _within(column, column.values.grad, self.start, self.stop).add_(gradient)


def _within(column: Column, values: Tensor, start: int, stop: int) -> Tensor:
    """The part of a tensor laid out like a column that successive rows have; shares memory."""
    if column.layout is Layout.STACKED:
        return values[:, start:stop]
    if column.offsets is not None:
        return values[int(column.offsets[start]) : int(column.offsets[stop])]
    return values[start:stop]
