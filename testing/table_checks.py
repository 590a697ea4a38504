"""Table checks: the rows of a model and the moments of its optimizer fit together."""

from __future__ import annotations

from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import PrimitiveModel
from gsfw.testing.promise import require

ADVICE = (
    "Edit rows only with context.table (append, keep, replace, edit), and give children with a "
    "value for every column of the model."
)


def check_table(model: PrimitiveModel, optimizer: Optimizer, when: str) -> None:
    """Check that all columns have as many rows, with moments of their shape, and are finite.

    Args:
        model: the model.
        optimizer: has the moments of its trained columns.
        when: the moment, as a phrase: "after step 3".

    Raises:
        BrokenPromise: a column or its moments do not fit.
    """
    columns = model.columns()
    counts = {name: column.num_rows for name, column in columns.items()}
    require(
        len(set(counts.values())) <= 1,
        f"{when}, columns have different numbers of rows: {counts}.",
        ADVICE,
    )
    for name, column in columns.items():
        require(
            not column.values.is_floating_point() or bool(column.values.isfinite().all()),
            f"{when}, column {name} is not finite.",
            "Check divisions and logarithms of new rows, and sums of before_backward, whose images "
            "and losses may be NaN (nan_to_num() removes them); observe gets zeros.",
        )
        for moments in optimizer.moments(name) if column.trained else ():
            require(
                moments.first.shape == column.values.shape == moments.second.shape,
                f"{when}, column {name} has the shape {tuple(column.values.shape)}, and its "
                f"moments {tuple(moments.first.shape)}.",
                ADVICE,
            )
