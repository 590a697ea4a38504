"""State of a divided model: whole in checkpoints, which do not depend on the number of processes.

A checkpoint has the rows of all processes in their order, as one of a single process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from torch import Tensor

from gsfw.core.column import Column, Layout
from gsfw.core.model import PrimitiveModel

VALUES = "values"
"""Name of a column's tensor in the state of a model, after that of the column."""
MOMENTS = ("first", "second")


def whole(
    state: Mapping[str, Any],
    model: PrimitiveModel,
    gather: Callable[[Tensor], Tensor | None],
) -> dict[str, Any]:
    """The state with the rows of all processes.

    Args:
        state: state of the training in this process.
        model: the model in this process.
        gather: returns the rows of all processes [n, ...], from those of this one.
    """
    return _changed(state, model, gather)


def rows_of(state: Mapping[str, Any], model: PrimitiveModel, rows: range) -> dict[str, Any]:
    """The state with some of the rows.

    Args:
        state: state of a training with all rows.
        model: any model of the same columns.
        rows: the successive rows to keep.
    """
    return _changed(state, model, lambda values: values[rows.start : rows.stop])


def num_rows(state: Mapping[str, Any], model: PrimitiveModel) -> int:
    """Number of rows of a checkpoint."""
    key, column = next(iter(_keys(model).items()))
    return by_row(column, state["model"][key]).shape[0]


def _changed(
    state: Mapping[str, Any],
    model: PrimitiveModel,
    change: Callable[[Tensor], Tensor | None],
) -> dict[str, Any]:
    """The state with other rows, column by column."""

    def changed(column: Column, values: Tensor) -> Tensor | None:
        rows = change(by_row(column, values).contiguous())
        return None if rows is None else by_row(column, rows).contiguous()

    tensors = dict(state["model"])
    for key, column in _keys(model).items():
        tensors[key] = changed(column, tensors[key])
    if "optimizer" not in state:  # The model alone.
        return {**state, "model": tensors}
    moments = dict(state["optimizer"]["moments"])
    for name, column in model.columns().items():
        if name in moments:
            moments[name] = [
                {**one, **{key: changed(column, one[key]) for key in MOMENTS}}
                for one in moments[name]
            ]
    optimizer = {**state["optimizer"], "moments": moments}
    return {**state, "model": tensors, "optimizer": optimizer}


def _keys(model: PrimitiveModel) -> dict[str, Column]:
    """The columns of a model, by the names of their tensors in its state."""
    own = {id(column) for column in model.columns().values()}
    return {
        f"{name}.{VALUES}": module
        for name, module in model.named_modules()
        if isinstance(module, Column) and id(module) in own
    }


def by_row(column: Column, values: Tensor) -> Tensor:
    """A tensor laid out like a column with its rows along the first axis, or back."""
    return values.movedim(0, 1) if column.layout is Layout.STACKED else values
